"""Commands about single experiments (friction, payload, drive gains, contact), and parts that commands share."""
