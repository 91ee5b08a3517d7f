"""Parts of emitted solvers: functions printed from programs, and a second solver with the tool as an input."""
