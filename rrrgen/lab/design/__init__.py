"""Design of exciting trajectories: motions within all limits along which the regressor is well conditioned."""
