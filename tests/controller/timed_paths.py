"""The full check of the limits between the points of timed paths: python -m tests.controller.timed_paths

125 random paths at 11, 51, 201 and 1001 points, 1000 instants in every interval.
"""

from __future__ import annotations

import numpy as np

from tests.controller.test_path_timing import excess_and_stretch


def main() -> None:
    """Print, for each number of points, the largest share of a limit and the stretch of the durations."""
    for points in (11, 51, 201, 1001):
        most, stretches = excess_and_stretch(125, points, 1000)
        text = f"{np.median(stretches):.4f} (median), {stretches.max():.4f} (most)"
        print(f"{points:5d} points: largest share of a limit 1 {most - 1.0:+.2e}, durations times {text}")


if __name__ == "__main__":
    main()
