"""The recorded control loop as an input of a study: its controller file, and recordings that are only scored."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rrrgen.lab.closed_loop.controller import LoopController, load_controller
from rrrgen.lab.closed_loop.loop_recording import NEEDED, require_inputs, require_joints
from rrrgen.lab.data.mapping import LogMapping
from rrrgen.lab.data.recordings import Log
from rrrgen.lab.identify.observations import Recording
from rrrgen.lab.studies.options import OptionError
from rrrgen.lab.studies.sources import RecordingInputs, recording_inputs
from rrrgen.robot.spec import RobotSpec


@dataclass(frozen=True)
class LoopInputs:
    """The ``controller`` of the recorded loop, None without one, and the recordings ``tests`` on which it is scored.

    ``files`` are the files read, by role.
    """

    controller: LoopController | None = None
    tests: RecordingInputs | None = None
    files: dict[str, Path] = field(default_factory=dict)

    def open(self) -> list[Recording]:
        """The test recordings."""
        return [] if self.tests is None else self.tests.open()


def read_loop(
    controller: Path | None, tests: Sequence[Path], spec: RobotSpec, recorded: RecordingInputs, skip_truncated: bool
) -> LoopInputs:
    """Read the ``controller`` file and the recordings ``tests``, which are scored but not fitted.

    Raises :class:`InputError` for a controller whose joints or inputs are not those of the recordings ``recorded`` and
    ``tests`` of the robot ``spec``.
    """
    if controller is None:
        if tests:
            raise OptionError("{tests} scores the simulated loop: give its {controller}, too")
        return LoopInputs()
    loop = load_controller(controller)
    scored = None
    if tests:
        scored = recording_inputs(tests, spec, skip_truncated_line=skip_truncated, role="test")
    for source in (*recorded.sources, *(() if scored is None else scored.sources)):
        require_joints(loop, source.joints if isinstance(source, Log) else source.names)
        require_inputs(loop, {name for name in NEEDED if _has(source, name)})
    files = {} if scored is None else scored.files
    return LoopInputs(loop, scored, files | {"controller": controller})


def _has(source: LogMapping | Log, signal: str) -> bool:
    """Whether a recording holds a signal of the controller."""
    return getattr(source, signal) is not None if isinstance(source, Log) else source.has(signal)  # type: ignore[arg-type]
