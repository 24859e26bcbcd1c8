from __future__ import annotations

from dataclasses import replace

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


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("size = 3".encode("utf-16"), "it is UTF-16 text; save it as UTF-8"),
        ("size = 3".encode("utf-16-be"), "it is UTF-16 text or no text, line 1"),
        ('name = "é"'.encode("latin-1"), "it is not UTF-8 text, line 1; save it as UTF-8"),
        (b"size = " + b"[" * 20000 + b"]" * 20000, "tables or lists are nested too deep"),
    ],
)
def test_a_file_that_is_no_toml_is_named_as_what_it_is(tmp_path, content, said):
    path = tmp_path / "ship.toml"
    path.write_bytes(content)
    message = sentence(toml_file, path, "The ship", OddError)
    assert message.startswith(f"The ship {path} ")
    assert said in message


def test_a_byte_order_mark_is_no_fault(tmp_path):
    path = tmp_path / "ship.toml"
    path.write_bytes("size = 3\r\n".encode("utf-8-sig"))
    assert toml_file(path, "The ship", OddError).value == {"size": 3}


def test_long_keys_values_and_reasons_are_cut(entry, tmp_path):
    assert len(sentence(replace(entry, value="y" * 5000).number)) < 150
    assert len(sentence(replace(entry, value={"k" * 5000: 1}).check_keys, ("a",))) < 150
    assert "unknown key 'a\\nb'" in sentence(replace(entry, value={"a\nb": 1}).check_keys, ("a",))
    path = tmp_path / "ship.toml"
    path.write_text(f"{'k' * 5000} = 1\n[{'k' * 5000}]")
    assert len(sentence(toml_file, path, "The ship", OddError).replace(str(path), "")) < 250
