"""The model functions of a compiled robot as methods: kinematics, dynamics, regressors."""
