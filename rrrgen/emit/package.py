"""The files that ``rrrgen generate`` writes: a model printed by all back ends, with build files and manifest."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from importlib import import_module
from itertools import chain, islice
from typing import TYPE_CHECKING, Any

from rrrgen.base.errors import BackendError
from rrrgen.base.parallel import Tell, parallel_map, without_collection
from rrrgen.robot.file.fields import LANGUAGES

if TYPE_CHECKING:
    from rrrgen.base.files import Contents
    from rrrgen.derive.derived_model import DerivedModel
    from rrrgen.emit import Real
    from rrrgen.emit.c.language import Trig
    from rrrgen.emit.interface import Backend, Rounding, SelfTestCheck
    from rrrgen.robot.identity import Identity
    from rrrgen.robot.spec import RobotSpec


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
    beside: Mapping[str, Contents] | None = None,
    checks: Sequence[SelfTestCheck] = (),
    rounding: Rounding | None = None,
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
        beside: files of other packages, in folders of their own, which the manifest lists too.
        checks: the self-tests of these files, which become part of the emitted self-test.
        rounding: proven bounds of the rounding errors of ``model``, for header and manifest; None states nothing.

    Raises:
        BackendError: a language cannot express a function.
        MissingExtraError: ``casadi_files`` without CasADi.
    """
    from rrrgen.base.files import MANIFEST
    from rrrgen.emit.c.robot_files import build_files
    from rrrgen.emit.manifest import manifest
    from rrrgen.robot.identity import identify

    identity, languages = identify(model.spec), tuple(dict.fromkeys(languages))
    backends = _backends(model.spec, real, trig, languages, checks, rounding or {})
    tasks = [backend.tasks(model, identity, real) for backend in backends]
    every: list[Callable[[], Any]] = [partial(_inverse_kinematics_data, model.spec, real), *chain.from_iterable(tasks)]
    data, *printed = parallel_map(_run, every, jobs, tell, "printing sources")
    parts = _assemble_files(model, identity, backends, tasks, printed)
    files = _merge(parts)
    models = [model] if any_gravity is None else [model, any_gravity]
    for other in models[1:]:
        files |= _further_model(other, real, trig, jobs, languages, tell)
    files |= further or {}
    listed = [(_place(part), LANGUAGES[language]) for language, part in zip(languages, parts[OWN:], strict=True)]
    files |= build_files(files, model, identity, real, listed)
    files |= beside or {}
    files[MANIFEST] = manifest(model, identity, real, files, data, any_gravity, rounding)
    if casadi_files:  # their bytes depend on the version of CasADi, so the manifest does not list them
        from rrrgen.emit.casadi.files import serialize

        files |= {f"casadi/{name}": data for derived_model in models for name, data in serialize(derived_model).items()}
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
    from rrrgen.emit.c.robot_files import CBackend
    from rrrgen.emit.casadi.files import CasadiBackend
    from rrrgen.robot.identity import identify

    identity = identify(model.spec)
    backends: list[Backend] = [CBackend(trig), CasadiBackend(), *map(_further_backend, languages)]
    tasks = [backend.tasks(model, identity, real) for backend in backends]
    printed = parallel_map(_run, list(chain.from_iterable(tasks)), jobs, tell, "printing sources")
    parts = _assemble_files(model, identity, backends, tasks, printed)
    moved = [{path.replace("/", "_any_gravity/", 1): text for path, text in part.items()} for part in parts[OWN:]]
    return _merge([*parts[:OWN], *moved])


def _assemble_files(
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


def _merge(parts: Iterable[dict[str, Contents]]) -> dict[str, Contents]:
    return {path: text for part in parts for path, text in part.items()}


def _place(files: Iterable[str]) -> str:
    """The folder or else the file that a language is printed to, as the README names it."""
    first = min(files)
    return first.split("/")[0] + "/" if "/" in first else first


OWN = 2
"""C and CasADi, the backends in front of those for other languages."""


def _backends(
    spec: RobotSpec,
    real: Real,
    trig: Trig,
    languages: Sequence[str],
    checks: Sequence[SelfTestCheck],
    rounding: Rounding,
) -> list[Backend]:
    """The backends for C and CasADi, then those for ``languages``."""
    from rrrgen.emit.c.robot_files import CBackend
    from rrrgen.emit.casadi.files import CasadiBackend

    c = CBackend(trig, partial(_beside, spec, real, checks), rounding)
    return [c, CasadiBackend(), *map(_further_backend, languages)]


def _further_backend(language: str) -> Backend:
    """The constant ``BACKEND`` of the module in ``backends`` that is called like the ``language``."""
    if language not in LANGUAGES:
        raise BackendError(f"unknown language {language!r}: " + ", ".join(LANGUAGES))
    backend: Backend = import_module(f"rrrgen.emit.targets.{language}").BACKEND
    return backend


def _beside(
    spec: RobotSpec, real: Real, checks: Sequence[SelfTestCheck]
) -> tuple[dict[str, str], Sequence[SelfTestCheck]]:
    """The C files of the inverse kinematics, and all checks of the self-test other than those of the model.

    The latter are the given ``checks`` and the one of the inverse kinematics.
    """
    from rrrgen.emit.c.ik.files import sources
    from rrrgen.emit.c.ik.self_test import selftest
    from rrrgen.emit.interface import SelfTestCheck

    tests = {
        name: selftest(spec, real, tip)
        for name, tip in [(spec.name, ""), *((f"{spec.name}_{tip}", tip) for tip in spec.tips)]
    }
    solver_checks = [
        SelfTestCheck(f"{name}_inverse_kinematics".removeprefix(f"{spec.name}_"), f"{name}_ik.h", text)
        for name, text in tests.items()
        if text
    ]
    return sources(spec, real), [*checks, *solver_checks]


def _inverse_kinematics_data(spec: RobotSpec, real: Real) -> dict[str, Any]:
    """The entry of the manifest about the inverse kinematics."""
    from rrrgen.emit.c.ik.files import manifest

    return manifest(spec, real)
