"""YAML with the meaning of the 1.2 core schema, and nothing that a hostile file could use."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from phys4dgen.errors import FormatError
from phys4dgen.yaml12 import MAX_BYTES, format_yaml, parse_yaml, read_yaml


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e6", 1e6),
        ("-1.5E-3", -1.5e-3),
        (".5", 0.5),
        ("1.", 1.0),
        ("0o17", 15),
        ("017", 17),
        ("0xff", 255),
        ("true", True),
        ("Null", None),
        ("~", None),
        ("-.inf", -math.inf),
        # Text, although readers of YAML 1.1 or with extensions think otherwise.
        ("on", "on"),
        ("yes", "yes"),
        ("no", "no"),
        ("1_000", "1_000"),
        ("12:30:45", "12:30:45"),
        ("2026-01-01", "2026-01-01"),
        ("'1e6'", "1e6"),
        ("-y", "-y"),
        ("<<", "<<"),
    ],
)
def test_plain_scalars_follow_the_core_schema(text, value):
    got = parse_yaml(f"key: {text}", source="test").value["key"]
    assert got == value
    assert type(got) is type(value)


@pytest.mark.parametrize(
    ("text", "line", "reason"),
    [
        ("a: 1\nb: 2\na: 3", "line 3", "written twice"),
        ("a: 1\n? " + "k" * 5000 + "\n: 3", "line 2", "at most 120 characters, got one of 5000: 'kkk"),
        ("a: !!python/object:os.system x", "line 1", "tags"),
        ("a: [1,", "line 1", "expected"),
        ("a: 1\n---\nb: 2", "line 2", "second"),
        ("a: &x\n  b: *x", "line 2", "alias"),
        ("? [1, 2]\n: 3", "line 1", "key"),
        ("%YAML 1.1\n---\na: on", "s.yaml", "directives"),
        ("a: \x00", "s.yaml", "character"),
        ("a: " + 40 * "[" + 40 * "]", "line 1", "deeper"),
        ("a: " + 5000 * "[", "line 1", "deeper"),
    ],
)
def test_bad_yaml_is_one_sentence_with_its_place(text, line, reason):
    with pytest.raises(FormatError) as caught:
        parse_yaml(text, source="s.yaml")
    message = str(caught.value)
    assert line in message
    assert reason in message
    assert "\n" not in message


def test_alias_bomb_is_refused_before_it_is_built():
    levels = ["a0: &a0 [x, x, x, x, x, x, x, x, x, x]"]
    levels += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 10)]
    with pytest.raises(FormatError, match="aliases"):
        parse_yaml("\n".join(levels), source="bomb.yaml")


def test_an_ordinary_alias_is_followed():
    assert parse_yaml("a: &p {hold: fixed}\nb: *p", source="t").value == {
        "a": {"hold": "fixed"},
        "b": {"hold": "fixed"},
    }


def test_a_file_that_is_too_long_is_not_read(tmp_path):
    path = tmp_path / "long.yaml"
    path.write_bytes(b"#" * (MAX_BYTES + 1))
    with pytest.raises(FormatError, match="at most"):
        read_yaml(path)


SCALARS = st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=20)
KEYS = st.text(max_size=12) | st.integers(-5, 500)
VALUES = st.recursive(
    SCALARS, lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=3), max_leaves=12
)


@settings(max_examples=150, deadline=None)
@given(st.dictionaries(KEYS, VALUES, max_size=4))
def test_what_is_written_reads_back_the_same(tree):
    assert parse_yaml(format_yaml(tree), source="round trip").value == tree
