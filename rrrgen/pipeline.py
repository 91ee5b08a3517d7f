"""The compiler on one page: from a robot file to its model, its (optimized) programs, and files or a callable model."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from importlib import import_module
from itertools import chain, islice
from typing import TYPE_CHECKING, Any, TypeAlias

from rrrgen.errors import BackendError
from rrrgen.parallel_map import Tell, parallel_map
from rrrgen.robotfile.keys import LANGUAGES

if TYPE_CHECKING:
    from rrrgen.backends import Identity, Real
    from rrrgen.backends.c.trigonometry import Trig
    from rrrgen.backends.interface import Backend, Check
    from rrrgen.derive.closed_forms.closed_form import ClosedForm
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.output.writer import Contents
    from rrrgen.robotfile.robot_spec import RobotSpec
    from rrrgen.runtime.engines import EngineName
    from rrrgen.runtime.model import Model

    Robot: TypeAlias = str | os.PathLike[str] | RobotSpec


@contextmanager
def without_collection() -> Iterator[None]:
    """Pause cyclic garbage collection: programs hold no reference cycles, and the search takes a tenth of the time."""
    was = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was:
            gc.enable()


@without_collection()
def derive(
    spec: RobotSpec, jobs: int = 1, groups: Sequence[str] = ("model",), tell: Tell | None = None
) -> DerivedModel:
    """Derive the functions of a robot: optimized programs, with their ``_nominal`` specializations.

    Args:
        spec: the robot, as :func:`rrrgen.load_spec` reads it.
        jobs: the largest number of processes; the result does not depend on it.
        groups: names of groups of functions: "model", "control", "observer", "points", "trajectory".
        tell: called as ``tell(done, total, message)`` as the work proceeds.

    Raises:
        DerivationError: a function does not exist for this robot.
    """
    from rrrgen.derive import derive_model
    from rrrgen.optimize import optimize

    return optimize(derive_model(spec, groups), jobs, tell)


def derive_once(spec: RobotSpec, groups: Sequence[str] = ("model",)) -> DerivedModel:
    """The result of :func:`derive`, from the user's cache if this robot has been derived before.

    Args:
        spec: the robot, as :func:`rrrgen.load_spec` reads it.
        groups: names of groups of functions, as for :func:`derive`.

    Raises:
        DerivationError: a function does not exist for this robot.
    """
    from rrrgen.output.manifest import identify
    from rrrgen.runtime.derived_cache import recall

    one = identify(replace(spec, ik="general"))  # no function depends on the choice of a solver
    return recall(spec, one, partial(derive, groups=groups), groups)


@without_collection()
def emit(
    model: DerivedModel,
    real: Real = "double",
    casadi_files: bool = False,
    trig: Trig = "inline",
    jobs: int = 1,
    languages: Sequence[str] = (),
    any_gravity: DerivedModel | None = None,
    tell: Tell | None = None,
    further: Mapping[str, str] | None = None,
    checks: Sequence[Check] = (),
) -> dict[str, Contents]:
    """Print a derived model as the files that ``rrrgen generate`` writes: relative path -> contents; writes nothing.

    Args:
        model: the derived robot, from :func:`derive`.
        real: the floating-point type of the C code, "double" or "float".
        casadi_files: add serialized CasADi functions (`.casadi` files), which need CasADi.
        trig: where sines and cosines come from: "inline", a kernel in the emitted code, or "libm", the C library.
        jobs: the largest number of processes; the result does not depend on it.
        languages: printed in addition to C and CasADi, "cpp" and "rust".
        any_gravity: the model of the same robot with gravity as an input, to be written beside it, or None.
        tell: called as ``tell(done, total, message)`` as the work proceeds.
        further: C files to be built and listed with those of the model.
        checks: the self-tests of these files, which become part of the emitted self-test.

    Raises:
        BackendError: a language cannot express a function.
        MissingExtraError: ``casadi_files`` without CasADi.
    """
    from rrrgen.backends import casadi
    from rrrgen.backends.c.packaging import build_files
    from rrrgen.output.manifest import identify, manifest
    from rrrgen.output.writer import MANIFEST

    identity, languages = identify(model.spec), tuple(dict.fromkeys(languages))
    backends = _backends(model.spec, real, trig, languages, checks)
    tasks = [backend.tasks(model, identity, real) for backend in backends]
    every: list[Callable[[], Any]] = [partial(_inverse_kinematics_data, model.spec, real), *chain.from_iterable(tasks)]
    data, *printed = parallel_map(_run, every, jobs, tell, "printing sources")
    parts = _assembled(model, identity, backends, tasks, printed)
    files = _merged(parts)
    models = [model] if any_gravity is None else [model, any_gravity]
    for other in models[1:]:
        files |= _further_model(other, real, trig, jobs, languages, tell)
    files |= further or {}
    listed = [(_place(part), LANGUAGES[each]) for each, part in zip(languages, parts[OWN:], strict=True)]
    files |= build_files(files, model, identity, real, listed)
    files[MANIFEST] = manifest(model, identity, real, files, data, any_gravity)
    if casadi_files:  # their bytes depend on the version of CasADi, so the manifest does not list them
        files |= {f"casadi/{name}": data for each in models for name, data in casadi.serialized(each).items()}
    return files


def _run(task: Callable[[], Any]) -> Any:
    """Run a task and return its result; a named function, because other processes must be able to import it."""
    return task()


def _further_model(
    model: DerivedModel, real: Real, trig: Trig, jobs: int, languages: Sequence[str], tell: Tell | None
) -> dict[str, Contents]:
    """Print the files of the model with gravity as an input: C with its self-test, CasADi, and the ``languages``.

    Folders of languages get names of their own, such as ``rust_any_gravity``.
    """
    from rrrgen.backends.c.backend import CBackend
    from rrrgen.backends.casadi.sources import CasadiBackend
    from rrrgen.output.manifest import identify

    identity = identify(model.spec)
    backends: list[Backend] = [CBackend(trig), CasadiBackend(), *map(_further_backend, languages)]
    tasks = [backend.tasks(model, identity, real) for backend in backends]
    printed = parallel_map(_run, list(chain.from_iterable(tasks)), jobs, tell, "printing sources")
    parts = _assembled(model, identity, backends, tasks, printed)
    moved = [{path.replace("/", "_any_gravity/", 1): text for path, text in part.items()} for part in parts[OWN:]]
    return _merged([*parts[:OWN], *moved])


def _assembled(
    model: DerivedModel,
    identity: Identity,
    backends: Sequence[Backend],
    tasks: Sequence[Sequence[Callable[[], Any]]],
    printed: Sequence[Any],
) -> list[dict[str, Contents]]:
    """The files of each of the ``backends``, path -> text, assembled from ``printed``.

    ``tasks`` holds the printing tasks of every backend; ``printed`` the results of all these tasks, in the same order.
    """
    results = iter(printed)
    parts: list[dict[str, Contents]] = []
    for backend, backend_tasks in zip(backends, tasks, strict=True):
        parts.append({**backend.assemble(model, identity, list(islice(results, len(backend_tasks))))})
    return parts


def _merged(parts: Iterable[dict[str, Contents]]) -> dict[str, Contents]:
    return {path: text for part in parts for path, text in part.items()}


def _place(files: Iterable[str]) -> str:
    """The folder or else the file that a language is printed to, as the README names it."""
    first = min(files)
    return first.split("/")[0] + "/" if "/" in first else first


OWN = 2
"""C and CasADi, the backends in front of those for other languages."""


def _backends(
    spec: RobotSpec, real: Real, trig: Trig, languages: Sequence[str], checks: Sequence[Check]
) -> list[Backend]:
    """The backends for C and CasADi, then those for ``languages``."""
    from rrrgen.backends.c.backend import CBackend
    from rrrgen.backends.casadi.sources import CasadiBackend

    return [CBackend(trig, partial(_beside, spec, real, checks)), CasadiBackend(), *map(_further_backend, languages)]


def _further_backend(language: str) -> Backend:
    """The constant ``BACKEND`` of the module in ``backends`` that is called like the ``language``."""
    if language not in LANGUAGES:
        raise BackendError(f"unknown language {language!r}: " + ", ".join(LANGUAGES))
    backend: Backend = import_module(f"rrrgen.backends.{language}").BACKEND
    return backend


def _beside(spec: RobotSpec, real: Real, checks: Sequence[Check]) -> tuple[dict[str, str], Sequence[Check]]:
    """The C files of the inverse kinematics, and all checks of the self-test other than those of the model.

    The latter are the given ``checks`` and the one of the inverse kinematics.
    """
    from rrrgen.backends.c.solver.checks import selftest
    from rrrgen.backends.c.solver.files import sources
    from rrrgen.backends.interface import Check

    text = selftest(spec, real)
    own = [Check("inverse_kinematics", f"{spec.name}_ik.h", text)] if text else []
    return sources(spec, real), [*checks, *own]


def _inverse_kinematics_data(spec: RobotSpec, real: Real) -> dict[str, Any]:
    """The entry of the manifest about the inverse kinematics."""
    from rrrgen.backends.c.solver.files import manifest

    return manifest(spec, real)


def compile(robot: Robot, backend: EngineName = "c", real: Real = "double") -> Model:
    """A callable model of a robot: derive, emit, build and load it.

    Derivations and built libraries are cached by content, so that the second call for a robot is fast.

    Args:
        robot: path of a robot file, name of a bundled robot such as "rrr", or a RobotSpec.
        backend: "c" compiles the emitted C code; "numpy" evaluates the same functions without a compiler, slowly.
        real: the floating-point type of the C code, "double" or "float".

    Raises:
        InputError: the robot file is faulty; the error lists every fault.
        BuildError: the C compiler is missing or fails.
    """
    return _compile(robot, backend, real)


@without_collection()
def _compile(robot: Robot, backend: EngineName, real: Real, groups: Sequence[str] = ("model",)) -> Model:
    """Make a callable model with the functions of ``groups``; other groups are compiled when first called."""
    from rrrgen.output.manifest import identify
    from rrrgen.runtime.load import load_model

    spec = read(robot)
    identity = identify(spec)
    derived = derive_once(spec, groups)
    again = partial(_compile, backend=backend, real=real)
    return load_model(derived, identity, backend, real, lambda name: closed_form(spec, name), again)


def closed_form(spec: RobotSpec, function: str) -> ClosedForm:
    """A function of a robot as exact SymPy expressions: index the result for entries, or call ``matrix()``.

    Args:
        spec: the robot, as :func:`rrrgen.load_spec` reads it.
        function: name of the function such as "mass_matrix"; of one with several results, "dynamics_terms.c".

    Raises:
        DerivationError: the function has no closed form.
    """
    from rrrgen.derive import prepare
    from rrrgen.derive.closed_forms.closed_form import closed_form as closed_form_of

    return closed_form_of(prepare(spec), function)


@without_collection()
def read(robot: Robot) -> RobotSpec:
    """Read the description of a robot.

    Args:
        robot: path of a robot file, name of a bundled robot such as "rrr", or a RobotSpec, which is returned as is.

    Raises:
        InputError: the file is faulty; the error lists every fault.
    """
    from rrrgen.robotfile import load_spec
    from rrrgen.robotfile.robot_spec import RobotSpec

    return robot if isinstance(robot, RobotSpec) else load_spec(robot)
