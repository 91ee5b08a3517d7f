"""The table of commands: the module and attribute, and the one-line help, by name.

A command is imported only when it is called.
"""

from __future__ import annotations

COMMANDS: dict[str, tuple[str, str]] = {
    "new": ("rrrgen.cli.new:new", "Write a robot file to start from."),
    "import": ("rrrgen.cli.import_robot:import_robot", "Write a robot file from one of another program."),
    "export": ("rrrgen.cli.export:export", "Write files of a robot for other programs."),
    "robots": ("rrrgen.cli.new:robots", "List the bundled robots."),
    "check": ("rrrgen.cli.check:check", "Check robot files and print every fault with its place."),
    "show": ("rrrgen.cli.show:show", "Print a robot: DH table, zero pose, base parameters, closed forms."),
    "generate": ("rrrgen.cli.generate:generate", "Write C and CasADi models of a robot."),
    "verify": ("rrrgen.cli.verify:verify", "Compare a compiled model with independent dynamics."),
    "certify": ("rrrgen.cli.certify:certify", "Write code with a certificate of what is proven and tested."),
    "ik": ("rrrgen.cli.ik:ik", "Solve the inverse kinematics for a pose."),
    "calibrate": (
        "rrrgen.cli.calibrate:calibrate",
        "Calibrate the geometry from measured poses, points or distances.",
    ),
    "excite": ("rrrgen.cli.excite:excite", "Design an exciting trajectory."),
    "simulate": ("rrrgen.cli.simulate:simulate", "Run an experiment on the virtual robot."),
    "reconstruct": (
        "rrrgen.cli.reconstruct:reconstruct",
        "Reconstruct the joint motion of a recording.",
    ),
    "identify": ("rrrgen.cli.identify:identify", "Estimate parameters from recordings."),
    "validate": ("rrrgen.cli.validate:validate", "Score a robot file against recordings."),
    "payload": ("rrrgen.cli.payload:payload", "Estimate a payload at the last link of a known arm."),
    "drive-gains": (
        "rrrgen.cli.drive_gains:drive_gains",
        "Estimate drive gains with a known payload.",
    ),
    "friction": ("rrrgen.cli.friction:friction", "Estimate the friction of one joint by experiment."),
    "frf": ("rrrgen.cli.frf:frf", "Estimate a frequency response with its uncertainty."),
    "contact-thresholds": (
        "rrrgen.cli.contact_thresholds:contact_thresholds",
        "Find thresholds of contact detection.",
    ),
    "linearise": (
        "rrrgen.cli.linearise:linearise",
        "Turn recordings of torques into recordings for frf.",
    ),
    "response-model": (
        "rrrgen.cli.response_model:response_model",
        "Fit a linear model and its resonances to a response.",
    ),
    "vibration": (
        "rrrgen.cli.vibration:vibration",
        "Design input shapers and notch filters against vibrations.",
    ),
    "case-study": ("rrrgen.cli.case_study:case_study", "Run the whole case study on the virtual RRR."),
    "doctor": ("rrrgen.cli.doctor:doctor", "Say what this installation can do, and what is missing."),
    "schema": ("rrrgen.cli.new:schema", "Print the JSON Schema of robot files, for editors."),
}
"""The commands by name: (module and attribute, one-line help). A new command takes one line here, and one file."""
