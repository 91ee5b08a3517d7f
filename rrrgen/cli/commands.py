"""The table of commands: the module and attribute, and the one-line help, by the words that call them.

A command is imported only when it is called.
"""

from __future__ import annotations

from importlib import import_module

import click

from rrrgen.base.errors import InputError, InternalError
from rrrgen.base.plugins import COMMANDS as PLUGINS
from rrrgen.base.plugins import Plugin, plugins

COMMANDS: dict[str, tuple[str, str]] = {
    "new": ("rrrgen.cli.new:new", "Write a robot file to start from."),
    "import": ("rrrgen.cli.import_robot:import_robot", "Write a robot file from one of another program."),
    "check": ("rrrgen.cli.check:check", "Check robot files and print every fault with its place."),
    "show": ("rrrgen.cli.show:show", "Print a robot: table, base parameters, closed forms."),
    "generate": ("rrrgen.cli.generate:generate", "Write C and CasADi models of a robot."),
    "verify": ("rrrgen.cli.verify:verify", "Compare a compiled model with independent dynamics."),
    "ik": ("rrrgen.cli.ik:ik", "Solve the inverse kinematics for a pose."),
    "calibrate": ("rrrgen.cli.calibrate:calibrate", "Calibrate the geometry from measured poses or distances."),
    "identify": ("rrrgen.cli.estimates:identify", "Estimate parameters from recordings."),
    "experiment excite": ("rrrgen.cli.excite:excite", "Design an exciting trajectory."),
    "experiment simulate": ("rrrgen.cli.simulate:simulate", "Run an experiment on the virtual robot."),
    "experiment reconstruct": ("rrrgen.cli.estimates:reconstruct", "Reconstruct the joint motion of a recording."),
    "experiment validate": ("rrrgen.cli.estimates:validate", "Score a robot file against recordings."),
    "experiment friction": ("rrrgen.cli.estimates:friction", "Estimate the friction of one joint by experiment."),
    "experiment payload": ("rrrgen.cli.estimates:payload", "Estimate a payload at the last link of a known arm."),
    "experiment drive-gains": ("rrrgen.cli.estimates:drive_gains", "Estimate drive gains with a known payload."),
    "experiment elastic-joints": (
        "rrrgen.cli.estimates:elastic_joints",
        "Estimate stiffness, damping and rotor inertia of joints.",
    ),
    "experiment contact-thresholds": (
        "rrrgen.cli.estimates:contact_thresholds",
        "Find thresholds of contact detection.",
    ),
    "experiment case-study": ("rrrgen.cli.case_study:case_study", "Run the whole case study on the virtual RRR."),
    "response linearise": ("rrrgen.cli.responses:linearise", "Turn recordings of torques into recordings for frf."),
    "response frf": ("rrrgen.cli.responses:frf", "Estimate a frequency response with its uncertainty."),
    "response matrix": ("rrrgen.cli.responses:matrix", "Estimate the frequency response of a whole arm."),
    "response model": ("rrrgen.cli.responses:response_model", "Fit a linear model with its resonances."),
    "response vibration": ("rrrgen.cli.vibration:vibration", "Design input shapers and notch filters."),
    "export": ("rrrgen.cli.export:export", "Write files of a robot for other programs."),
    "certify": ("rrrgen.cli.certify:certify", "Write code with a certificate of what is proven and tested."),
    "robots": ("rrrgen.cli.new:robots", "List the bundled robots."),
    "playground": ("rrrgen.cli.playground:playground", "Serve the page that runs the compiler in a browser."),
    "schema": ("rrrgen.cli.new:schema", "Print the JSON Schema of robot files, for editors."),
    "doctor": ("rrrgen.cli.doctor:doctor", "Say what this installation can do, and what is missing."),
}
"""The commands: (module and attribute, one-line help). A new command takes one line here."""

GROUPS = {
    "experiment": "Plan, simulate and evaluate experiments on an arm.",
    "response": "Measure and model the flexible dynamics of a joint.",
}
"""The groups of commands, with their one-line help."""

FURTHER = ("export", "certify", "robots", "playground", "schema", "doctor")
"""Commands that the first help names in one line only; ``rrrgen --help-all`` describes them."""

RENAMED = {path.split()[1]: path for path in COMMANDS if " " in path and path != "response model"} | {
    "response-model": "response model"
}
"""Old names of the commands that are in groups now, with the words that call them today; they still work."""


def further_commands() -> dict[str, Plugin]:
    """The commands that other installed packages add by entry points, by name; names of the table are not theirs."""
    return {plugin.name: plugin for plugin in plugins(PLUGINS) if plugin.name not in {*COMMANDS, *GROUPS, *RENAMED}}


def load_further_command(plugin: Plugin) -> click.Command:
    """Import the command of another package; raises InputError if it is none."""
    command = plugin.load()
    if not isinstance(command, click.Command):
        raise InputError(f"{plugin.where} is no click command, but {type(command).__name__}")
    command.name = plugin.name
    return command


def load_command(path: str) -> click.Command:
    """Import the command that the words ``path`` call, such as "experiment excite"."""
    module, attribute = COMMANDS[path][0].split(":")
    command = getattr(import_module(module), attribute)
    if not isinstance(command, click.Command):
        raise InternalError(f"{COMMANDS[path][0]} is no command")
    command.name = path.split()[-1]  # click names it after its function, which cannot be called "import"
    return command
