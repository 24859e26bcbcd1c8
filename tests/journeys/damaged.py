"""Result files with random damage: bits, blocks, ends and numbers of files that others wrote or copied badly."""

from __future__ import annotations

import json
import re

ODD = (None, True, -1, 1e999, "", "x" * 50, [], [[[]]], {}, {"a": 1}, 1e300)


def flipped_bit(rng, raw):
    spoilt = bytearray(raw)
    spoilt[rng.integers(len(spoilt))] ^= 1 << int(rng.integers(8))
    return bytes(spoilt)


def other_digit(rng, raw):
    """One digit of a number of a text; a flipped bit where there is none."""
    places = [found.start() for found in re.finditer(rb"(?<=[\d.])\d", raw)]
    if not places:
        return flipped_bit(rng, raw)
    place = places[rng.integers(len(places))]
    return raw[:place] + str((int(raw[place : place + 1]) + 1) % 10).encode() + raw[place + 1 :]


def zeroed_block(rng, raw):
    begin = int(rng.integers(len(raw)))
    length = int(rng.integers(1, 513))
    return raw[:begin] + bytes(len(raw[begin : begin + length])) + raw[begin + length :]


def cut_off(rng, raw):
    return raw[: rng.integers(len(raw))]


def longer(rng, raw):
    return raw + rng.bytes(int(rng.integers(1, 200)))


def twice(rng, raw):
    begin = int(rng.integers(len(raw)))
    return raw[:begin] + raw


def nested(rng, raw):
    return b"[" * 200_000


def other_value(rng, raw):
    """Another value at a key of a JSON text; a flipped bit where it is none."""
    try:
        table = json.loads(raw)
    except ValueError:
        return flipped_bit(rng, raw)
    node = table
    while True:
        keys = list(node) if isinstance(node, dict) else list(range(len(node)))
        key = keys[rng.integers(len(keys))]
        if not isinstance(node[key], dict | list) or not node[key] or rng.random() < 0.3:
            node[key] = ODD[rng.integers(len(ODD))]
            return json.dumps(table).encode()
        node = node[key]


KINDS = (flipped_bit, flipped_bit, other_digit, zeroed_block, cut_off, longer, twice, nested, other_value)


def damage(folder, rng):
    """Damage a file below a folder; now and then remove it or put another one in its place."""
    files = sorted(path for path in folder.rglob("*") if path.is_file() and path.stat().st_size)
    path = files[rng.integers(len(files))]
    chance = rng.random()
    if chance < 0.04:
        path.unlink()
    elif chance < 0.08:
        path.write_bytes(files[rng.integers(len(files))].read_bytes())
    else:
        path.write_bytes(KINDS[rng.integers(len(KINDS))](rng, path.read_bytes()))
    return path
