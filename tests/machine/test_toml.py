from __future__ import annotations

import pytest

from pymc_ship.machine.toml import Entry, toml_file


class OddError(ValueError):
    pass


@pytest.fixture
def entry():
    """Table of a file with a number, a text and a table in a table."""
    return Entry({"size": 3, "name": "hull", "inner": {"deeper": {"x": "y"}}}, "ship.toml", OddError)


def sentence(check, *arguments, **settings):
    with pytest.raises(OddError) as error:
        check(*arguments, **settings)
    return str(error.value)


def test_values_that_pass_come_back(entry):
    entry.check_keys(("size", "name", "inner", "more"), ("size",))
    assert entry.at("size").whole(least=3) == 3
    assert entry.at("size").number(least=3.0) == 3.0
    assert entry.at("more", 0.5).number() == 0.5
    assert entry.at("name").text() == "hull"
    assert entry.at("name").choice(("hull", "rudder")) == "hull"
    assert list(entry) == ["size", "name", "inner"]
    assert "size" in entry
    assert "more" not in entry


def test_the_keys_of_a_table_are_checked(entry):
    deeper = entry.at("inner").at("deeper")
    assert sentence(deeper.check_keys, ("a", "b")) == ("ship.toml: unknown key inner.deeper.x; known here are a, b.")
    assert sentence(deeper.check_keys, ("x", "b"), ("x", "b")) == "ship.toml: inner.deeper.b is missing; add it."
    assert sentence(entry.check_keys, ("name",)) == "ship.toml: unknown key size; known here are name."
    assert sentence(entry.at("size").check_keys, ()) == "ship.toml: size must be a table, found 3; correct it."


def test_the_kind_of_a_value_is_checked(entry):
    name, size = entry.at("name"), entry.at("size")
    assert sentence(name.number) == "ship.toml: name must be a finite number, found 'hull'; correct it."
    assert sentence(size.number, least=4.0) == "ship.toml: size must be a number from 4 up, found 3; correct it."
    assert sentence(size.whole, least=4) == "ship.toml: size must be a whole number from 4 up, found 3; correct it."
    assert "found True" in sentence(entry.at("more", True).whole, least=0)
    assert sentence(size.text) == "ship.toml: size must be a text, found 3; put it in quotes."
    assert sentence(name.choice, ("a", "b")) == "ship.toml: name is one of a, b; found 'hull'; choose one of them."
    assert sentence(size.fail, "is odd; mend it.") == "ship.toml: size is odd; mend it."


def test_a_file_is_a_table_or_an_error_in_one_sentence(tmp_path):
    path = tmp_path / "ship.toml"
    assert sentence(toml_file, path, "The ship", OddError) == (
        f"The ship {path} cannot be read: No such file or directory; check the path."
    )
    path.write_text("size = ")
    assert sentence(toml_file, path, "The ship", OddError).startswith(f"The ship {path} is not valid TOML: ")
    path.write_text("size = 3")
    assert toml_file(path, "The ship", OddError) == Entry({"size": 3}, str(path), OddError)


@pytest.mark.parametrize("text", ["x = " + "[" * 20_000, "x = " + "{y = " * 20_000])
def test_what_is_nested_too_deep_is_refused_in_a_sentence(tmp_path, text):
    path = tmp_path / "ship.toml"
    path.write_text(text)
    expected = f"The ship {path} is not valid TOML: its tables or lists are nested too deep; mend it."
    assert sentence(toml_file, path, "The ship", OddError) == expected


def test_the_encoding_of_a_file_is_named(tmp_path):
    path = tmp_path / "ship.toml"
    path.write_text("size = 3", encoding="utf-16")
    expected = f"The ship {path} cannot be read: it is UTF-16 text; save it as UTF-8."
    assert sentence(toml_file, path, "The ship", OddError) == expected
    path.write_text("size = 3", encoding="utf-8-sig")
    assert toml_file(path, "The ship", OddError).value == {"size": 3}
