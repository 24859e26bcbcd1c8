"""Style of matplotlib figures, and their SVG and PNG."""

import base64
import io
import re
from html import escape
from typing import Any

import matplotlib
import numpy as np
import xarray as xr
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from PIL import Image

STYLE: dict[Any, Any] = {  # matplotlib settings of every figure; the salt makes the SVG reproducible
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "svg.hashsalt": "pymc_ship",
    "axes.titlesize": 9.5,
}
REFERENCE, NOISE = "#1b1b1b", "#b9c0c8"
BLUE, RUST = "#1f6fb2", "#c8551b"  # the first and second colour of most figures
DOF_COLOURS = {"surge": BLUE, "sway": RUST, "yaw": "#3a8f4d", "roll": "#7d4fa3"}
METHOD_COLOURS = ("#7fb2dd", BLUE, "#3a8f4d", RUST, "#7d4fa3")
BESIDE_DPI, EMBEDDED_DPI = 110, 120  # of PNG files, and of PNG images inside a page [dots per inch]


house_style = matplotlib.rc_context(STYLE)  # decorator of the functions that draw


def subplots(
    width: float, height: float, rows: int = 1, columns: int = 1, **settings: Any
) -> tuple[Figure, np.ndarray]:
    """Figure [inch] with constrained layout and its axes, shape (rows, columns); never touches pyplot."""
    fig = Figure(figsize=(width, height), layout="constrained")
    return fig, fig.subplots(rows, columns, squeeze=False, **settings)


def thinned(record: xr.Dataset, points: int) -> xr.Dataset:
    """Every n-th sample of a record, about so many ``points``."""
    return record.isel(time=slice(None, None, max(1, record.sizes["time"] // points)))


def _lay_out(fig: Figure) -> None:
    """Lay a figure out once: the constrained layout would move its axes at every draw."""
    if (engine := fig.get_layout_engine()) is not None:
        engine.execute(fig)
        fig.set_layout_engine("none")


@house_style
def svg(fig: Figure, name: str) -> str:
    """Figure as reproducible SVG text; its ids begin with the name."""
    _lay_out(fig)
    buffer = io.BytesIO()
    FigureCanvasSVG(fig).print_svg(buffer, metadata={"Date": None})
    text = buffer.getvalue().decode()
    return re.sub(r'(\bid="|href="#|url\(#)', rf"\g<1>{name}.", text[text.index("<svg") :])


@house_style
def png(fig: Figure, dpi: int) -> bytes:
    """Figure as PNG bytes at a resolution [dots per inch], with a palette: a third of the size of full colour."""
    _lay_out(fig)
    canvas, own_dpi = FigureCanvasAgg(fig), fig.dpi
    fig.set_dpi(dpi)
    canvas.draw()
    fig.set_dpi(own_dpi)
    pixels = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    buffer = io.BytesIO()
    pixels.quantize(dither=Image.Dither.NONE).save(buffer, "PNG", dpi=(dpi, dpi))
    return buffer.getvalue()


def html_image(fig: Figure, alternative: str) -> str:
    """Figure as an HTML image with its PNG inside, for figures with too many points for SVG."""
    data = base64.b64encode(png(fig, EMBEDDED_DPI)).decode()
    return f'<img alt="{escape(alternative)}" src="data:image/png;base64,{data}">'
