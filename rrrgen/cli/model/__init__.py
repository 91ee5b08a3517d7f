"""Commands about a model: new, robots, check, show, schema, generate, verify, ik."""
