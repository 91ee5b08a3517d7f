"""Long fuzzing: damaged files for every reader, hostile numbers for every emitted function under sanitizers.

    make fuzz                                ten minutes for the readers together, ten for each robot's C
    python tests/fuzz.py --seconds 60 --seed 7 --robots rrr xarm6 --only code

The readers are those of `tests/damage`, with ever new damage. The C of a robot, from `rrrgen generate`, is built with
gcc's address and undefined-behaviour sanitizers, conversions of numbers out of range included; a driver made from the
manifest draws a function, fills its inputs with numbers that are ordinary, not finite, huge, tiny or zero, and calls
it. Solutions of inverse kinematics that are called OK must be finite. What fails is printed with the seed that repeats
it; exit code 1 then.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
ROBOTS = ("rrr", "scara", "stanford", "ur5", "panda", "xarm6")
SANITIZERS = "-fsanitize=address,undefined,float-cast-overflow -fno-sanitize-recover=all"

DRIVER = """#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
{includes}

static uint64_t state;
static uint64_t next(void)
{{
    uint64_t z = (state += 0x9E3779B97F4A7C15u);
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}}

static double number(int hostile)
{{
    static const double wild[] = {{NAN, INFINITY, -INFINITY, 1e308, -1e308, 1e160, 1e20, 2147483648.0, 5e-324, -1e-300,
                                  0.0, -0.0, 1e6, 3.141592653589793, 1.5707963267948966, 1e-9}};
    const double u = (double)(next() >> 11) / 9007199254740992.0;
    if (hostile && next() % 4u == 0u) {{
        return wild[next() % (sizeof(wild) / sizeof(wild[0]))];
    }}
    return 6.4 * (u - 0.5);
}}

static void fill({real} *x, int n)
{{
    const int hostile = next() % 2u == 0u;
    int i;
    for (i = 0; i < n; ++i) {{
        x[i] = ({real})number(hostile);
    }}
}}

{functions}
typedef void (*call)(void);
static const call calls[] = {{{names}}};

int main(int argc, char **argv)
{{
    const uint64_t first = strtoull(argv[1], NULL, 10);
    const double seconds = strtod(argv[2], NULL);
    const time_t start = time(NULL);
    uint64_t k;
    (void)argc;
    for (k = first; difftime(time(NULL), start) < seconds; ++k) {{
        int repeat;
        state = k;
        for (repeat = 0; repeat < 1000; ++repeat) {{
            calls[next() % (sizeof(calls) / sizeof(calls[0]))]();
        }}
        printf("%llu\\n", (unsigned long long)k);
        fflush(stdout);
    }}
    return 0;
}}
"""


def _count(shape: list[int]) -> int:
    return math.prod(shape)


def _function(robot: str, real: str, name: str, ports: dict[str, Any]) -> str:
    """A C function that calls one model function with random inputs."""
    declared, filled, given = [], [], []
    for port in ports["inputs"]:
        size = _count(port["shape"])
        declared.append(f"{real} {port['name']}[{size}];")
        filled.append(f"fill({port['name']}, {size});")
        given.append(port["name"] if port["shape"] else f"{port['name']}[0]")
    for port in (each for each in ports["outputs"] if each["name"] != "status"):  # that is returned
        declared.append(f"{real} out_{port['name']}[{_count(port['shape'])}];")
        given.append(f"out_{port['name']}")
    body = "\n    ".join([*declared, *filled, f"(void){robot}_{name}({', '.join(given)});"])
    return f"static void call_{name}(void)\n{{\n    {body}\n}}\n"


def _solver(robot: str, real: str, redundant: bool) -> str:
    """A C function that solves for a random target, every second time the pose of a random posture."""
    M = robot.upper()
    lock = "lock[0], " if redundant else ""
    return f"""static void call_inverse_kinematics(void)
{{
    {real} target[{M}_IK_TARGET], ref[{M}_IK_JOINTS], T[16], lock[1];
    {robot}_ik_solutions found;
    int i, k;
    fill(target, {M}_IK_TARGET);
    fill(ref, {M}_IK_JOINTS);
    fill(lock, 1);
    if (next() % 2u == 0u) {{
        {robot}_forward_kinematics(ref, T);
        for (i = 0; i < {M}_IK_TARGET; ++i) {{
            target[i] = {M}_IK_TARGET == 3 ? T[4 * i + 3] : T[i];
        }}
    }}
    i = (int){robot}_inverse_kinematics(target, (next() % 4u == 0u) ? NULL : ref, {lock}(unsigned)next(), &found);
    if (found.count < 0 || found.count > {M}_IK_ROWS) {{
        fprintf(stderr, "%d solutions\\n", found.count);
        abort();
    }}
    for (k = 0; i == {M}_IK_OK && k < {M}_IK_JOINTS * found.count; ++k) {{
        if (!isfinite(found.q[k / {M}_IK_JOINTS][k % {M}_IK_JOINTS])) {{
            fprintf(stderr, "a solution is not finite; target:");
            for (i = 0; i < {M}_IK_TARGET; ++i) {{
                fprintf(stderr, " %a", (double)target[i]);
            }}
            fprintf(stderr, "; reference:");
            for (i = 0; i < {M}_IK_JOINTS; ++i) {{
                fprintf(stderr, " %a", (double)ref[i]);
            }}
            abort();
        }}
    }}
}}
"""


def code(robot: str, real: str, seed: int, seconds: float, folder: Path) -> str:
    """Fuzz the C of one robot; returns what was found, "" if nothing."""
    command = [sys.executable, "-m", "rrrgen", "generate", robot, "--with", "control,trajectory", "--real", real]
    subprocess.run([*command, "-o", str(folder), "--no-casadi-files"], check=True, cwd=ROOT, stdout=subprocess.DEVNULL)
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    name = manifest["robot"]
    functions = [_function(name, real, each, ports) for each, ports in manifest["functions"].items()]
    names = [f"call_{each}" for each in manifest["functions"]]
    if manifest["inverse_kinematics"]["solver"]:
        functions.append(_solver(name, real, bool(manifest["inverse_kinematics"]["redundancy"])))
        names.append("call_inverse_kinematics")
    headers = sorted(path.name for path in folder.glob("*.h"))
    text = DRIVER.format(
        includes="\n".join(f'#include "{header}"' for header in headers),
        real=real,
        functions="\n".join(functions),
        names=", ".join(names),
    )
    (folder / "fuzz_driver.c").write_text(text, encoding="utf-8")
    sources = [path.name for path in folder.glob("*.c") if "selftest" not in path.name]
    build = ["gcc", "-std=c99", "-O1", "-g", *SANITIZERS.split(), *sources, "-lm", "-o", "fuzz"]
    done = subprocess.run(build, cwd=folder, capture_output=True, text=True, check=False)
    if done.returncode:
        return done.stderr[:3000]
    run = subprocess.run(["./fuzz", str(seed), str(seconds)], cwd=folder, capture_output=True, text=True, check=False)
    rounds = run.stdout.split()
    print(f"{robot}, {real}: {1000 * len(rounds)} calls of {len(names)} functions", flush=True)
    if run.returncode == 0:
        return ""
    return f"seed {int(rounds[-1]) + 1 if rounds else seed}: {run.stderr[:3000]}"


def readers(seed: int, seconds: float) -> str:
    """Fuzz all readers with ever new damage; returns what was found."""
    end, first, step = time.monotonic() + seconds, 1000 * seed, 50
    tests = str(ROOT / "tests" / "damage" / "test_readers.py")
    while time.monotonic() < end:
        environment = {**os.environ, "RRRGEN_FUZZ": str(step), "RRRGEN_FUZZ_FROM": str(first)}
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", tests, "-k", "damaged"]
        done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            return f"RRRGEN_FUZZ={step} RRRGEN_FUZZ_FROM={first}: {done.stdout[-3000:]}"
        first += step
    print(f"readers: {first - 1000 * seed} damaged files of every format", flush=True)
    return ""


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("--seconds", type=float, default=600.0, help="time for the readers, and for each robot (600)")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="of all inputs; a new one each time")
    parser.add_argument("--robots", nargs="*", default=ROBOTS, help="bundled names or robot files")
    parser.add_argument("--only", choices=("readers", "code"), help="leave out the other")
    arguments = parser.parse_args()
    print(f"seed {arguments.seed}", flush=True)
    found = []
    if arguments.only != "code":
        found.append(("readers", readers(arguments.seed % 100_000, arguments.seconds)))
    if arguments.only != "readers":
        for robot in arguments.robots:
            for real in ("double", "float"):
                with tempfile.TemporaryDirectory(prefix="rrrgen-fuzz-") as folder:
                    found.append(
                        (f"{robot}, {real}", code(robot, real, arguments.seed, arguments.seconds / 2.0, Path(folder)))
                    )
    failed = [(what, text) for what, text in found if text]
    for what, text in failed:
        print(f"{what}: {text}")
    print("nothing was found" if not failed else f"{len(failed)} findings")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
