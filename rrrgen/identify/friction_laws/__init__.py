"""Friction laws in the joint estimation: shapes by variable projection, choice of the law by held-out error."""
