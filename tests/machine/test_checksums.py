import pytest

from pymc_ship.machine.checksums import append_checksum, folder_checksum, has_valid_checksum


@pytest.mark.parametrize("content", [b"", b"a", b"ab" * (1 << 20) + b"c"])
def test_a_file_with_its_checksum_is_whole_until_a_bit_of_it_changes(tmp_path, content):
    path = tmp_path / "data"
    path.write_bytes(content)
    assert has_valid_checksum(path)  # it carries none
    append_checksum(path)
    assert has_valid_checksum(path)
    whole = path.read_bytes()
    assert whole.startswith(content)
    assert len(whole) == len(content) + 81
    for place in {*({0, len(content) // 2} if content else ()), len(whole) - 64, len(whole) - 1}:
        damaged = bytearray(whole)
        damaged[place] ^= 1
        path.write_bytes(damaged)
        assert not has_valid_checksum(path)
    path.write_bytes(b"more" + whole)
    assert not has_valid_checksum(path)


def test_the_checksum_of_a_folder_is_that_of_names_contents_and_index(tmp_path):
    for name in "ab":
        (tmp_path / name).write_text(name)
    whole = folder_checksum(tmp_path, ["a", "b"], {"x": 1, "y": [2.5]})
    assert folder_checksum(tmp_path, ["b", "a"], {"y": [2.5], "x": 1}) == whole
    assert folder_checksum(tmp_path, ["a", "b"], {"x": 1, "y": [2.6]}) != whole
    assert folder_checksum(tmp_path, ["a"], {"x": 1, "y": [2.5]}) != whole
    (tmp_path / "a").write_text("c")
    assert folder_checksum(tmp_path, ["a", "b"], {"x": 1, "y": [2.5]}) != whole
