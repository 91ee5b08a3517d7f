"""The chain as inverse kinematics sees it: rigid transforms, loops, special positions of axes."""
