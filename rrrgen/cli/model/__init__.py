"""Commands about a model: new, import, robots, check, show, schema, generate, verify, ik."""
