"""Write the figures of the documentation and its page on what to expect: ``python -m studies.documentation``."""

from pymc_ship.pages.drawing import BESIDE_DPI, png
from studies.documentation.figures import FIGURES
from studies.documentation.tables import ROOT
from studies.documentation.what_to_expect import what_to_expect

if __name__ == "__main__":
    (ROOT / "docs" / "what_to_expect.md").write_text(what_to_expect(), encoding="utf-8")
    for name, draw in FIGURES.items():
        (ROOT / "docs" / "figures" / f"{name}.png").write_bytes(png(draw(), BESIDE_DPI))
