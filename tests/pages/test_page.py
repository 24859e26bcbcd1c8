import pytest
from jinja2 import UndefinedError

from pymc_ship.pages.page import rendered


def test_a_page_escapes_its_content_and_misses_no_name():
    content = {"defaults": "", "back": "", "sections": [], "figures": {}, "versions": "", "sources": []}
    assert "<h1>a &lt; b</h1>" in rendered("diagnostics/page.html.j2", title="a < b", **content)
    with pytest.raises(UndefinedError, match="'title' is undefined"):
        rendered("diagnostics/page.html.j2", **content)
