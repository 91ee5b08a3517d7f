"""Commands about a robot's model: new, import, export, robots, check, show, schema, generate, verify, ik."""
