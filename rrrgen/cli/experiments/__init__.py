"""Parts of commands that belong to experiments: response experiments, and estimators for the controller."""
