"""Common style of the figures of the identification workflow, saved reproducibly as SVG and PNG."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rrrgen.base.files import write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


PRINT = 300
"""Resolution of the PNG files, dots per inch: what journals ask for."""


def new_figure(
    rows: int, columns: int, height: float, width: float = 7.0, layout: Any = "constrained", **options: Any
) -> tuple[Figure, Any]:
    """Create a figure outside pyplot's global state; returns it with a flat array of its ``rows*columns`` axes.

    ``height`` and ``width`` are in inches. ``layout`` is matplotlib's layout engine; "none" switches the automatic
    arrangement off. ``options`` are passed to ``Figure.subplots``.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout=layout)
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False, **options)
    return figure, axes.ravel()


def style_axes(axis: Any, xlabel: str, ylabel: str) -> None:
    """Set the axis labels (no label where the text is empty) and draw a light grid."""
    if xlabel:
        axis.set_xlabel(xlabel)
    axis.set_ylabel(ylabel)
    axis.grid(True, linewidth=0.4, alpha=0.5)
    axis.margins(x=0.01)


def save_figure(figure: Figure, stem: Path) -> list[Path]:
    """Write ``stem.svg`` and ``stem.png``; returns the paths. Without dates: the same data give the same bytes."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    paths = [stem.with_name(stem.name + suffix) for suffix in (".svg", ".png")]
    vectors, pixels = BytesIO(), BytesIO()
    resolution, engine = figure.dpi, figure.get_layout_engine()
    with matplotlib.rc_context({"svg.hashsalt": "rrrgen", "svg.fonttype": "none"}):
        if engine is not None:  # the automatic layout is slow: computed once for both files
            engine.execute(figure)
            figure.set_layout_engine("none")
        # not by savefig, which would draw figures that had an automatic layout twice for each file
        vector_canvas: Any = FigureCanvasSVG(figure)
        vector_canvas.print_svg(vectors, metadata={"Date": None, "Creator": None})
        figure.dpi = PRINT
        canvas: Any = FigureCanvasAgg(figure)
        canvas.print_png(pixels, metadata={"Software": None})
        figure.dpi = resolution
    for path, content in zip(paths, (vectors, pixels), strict=True):
        write_file(path, content.getvalue())
    return paths
