"""How files are damaged: bytes, lines, encodings, and values in their places."""

# ruff: noqa: E501 - one case a line

import copy
import random
import struct
from collections.abc import Callable
from typing import Any

SPLICES = [
    b"", b"0", b"-1", b"1e999", b"NaN", b"-inf", b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b'"', b"'", b"[", b"]", b"{}",
    b"null", b"true", b"../outside/secret.txt", b"<!ENTITY x SYSTEM 'file:///etc/passwd'>", b"9" * 400, b"\n", b"\r",
    b",", b";", b"\t", b"1e308", b"=", b"#", b"\x1b[2J", b"{{", b"{%", b"%}", b"%s", b"\xe2\x80\xae", b"[" * 2000,
    b"1_000", "٣".encode(), b"0x10", b"1e-400",
]  # fmt: skip
WORDS = [
    struct.pack(form, value)
    for form in ("<i", ">i", "<q", ">q", "<d", ">d", "<H")
    for value in ((0, 1, 255, 65535) if form == "<H" else (0, -1, 1, 2**31 - 1, -(2**31), 2**20))
] + [struct.pack("<d", float(x)) for x in ("nan", "inf", "1e300", "-1e-300")]  # fmt: skip
TEXTS = [
    "", " ", "nan", "NaN", "inf", "-inf", "1e999", "1e300", "-1e300", "5e-324", "0", "-1", "1,5", "9**9**9 m", "1 m",
    "1 mm", "1 s", "1 ms", "1 Hz", "1 kHz", "1 furlong", "1 degC", "3 dB", "1 m/m/m/m", "1 /", "(((1 m", "1 m^0.5",
    "-0", "1e5 yr", "m", "s", "ms", "μs", "%", "1 %", "a" * 100_000, "\x1b[31mred", "\x00", "a\nb", "\u202eabc", "\ud800",
    "../outside/secret.txt", "../outside/secret.nc", "/etc/passwd", "..", "/", ".", "~", "${HOME}", "${CALIB_DATA}/x.nc",
    "file:///etc/passwd", "journal", "sqlite:////nowhere/x.db", "{{ 7 * 7 }}", "%s%s%n", "os:system", "builtins:eval",
    "os.path:join", "tiny_simulators:Echo", "no_such_module:Thing", ":", "a:b:c", "q3", "displacement", "velocity", "log",
    "linear", "calibrate", "holdout", "phase_curve", "time_history", "gain@bench", "@", "a/b", "a\\b", "ok", "diverged",
]  # fmt: skip
NUMBERS: list[Any] = [
    0, -1, 1, 2, 3, 7, 255, 2**31, 2**63, 2**64, -(2**63) - 1, 10**30, 10**308, 10**400, 0.0, -0.0, 0.5, 1e-300, 5e-324,
    1e300, -1e300, 1.7976931348623157e308, float("nan"), float("inf"), float("-inf"), 1e-9, 1e9, 1e15, True, False, None,
]  # fmt: skip
MAX_REPEATED = 2_000_000  # bytes
NESTED = 10_000  # lists within one another


def nested(depth: int) -> list:
    """A list in a list in a list."""
    value: list = []
    for _ in range(depth):
        value = [value]
    return value


def value(rng: random.Random, deep: bool = False) -> Any:
    """A value that nobody expects; `deep` allows what recursive writers cannot write."""
    match rng.randrange(8):
        case 0 | 1 | 2:
            return rng.choice(TEXTS)
        case 3 | 4 | 5:
            return rng.choice(NUMBERS)
        case 6:
            return rng.choice([[], {}, [[]], {"": ""}, [1, "a", None], {"a": {"b": {}}}, list(range(1000)), [""] * 50])
    return nested(NESTED if deep else 50) if rng.random() < 0.3 else rng.choice(TEXTS) * rng.randint(1, 3)


def damaged(content: bytes, rng: random.Random, most: int = 6) -> bytes:
    """Bytes with a few places changed, cut, doubled, exchanged or spliced."""
    raw = bytearray(content)
    for _ in range(rng.randint(1, most)):
        at = rng.randrange(len(raw) + 1)
        length = rng.choice([1, 4, 8, 40, 200])
        match rng.randrange(9):
            case 0 if at < len(raw):
                raw[at] = rng.randrange(256)
            case 1 if at < len(raw):
                raw[at] ^= 1 << rng.randrange(8)
            case 2:
                del raw[at : at + length]
            case 3:
                raw[at:at] = rng.choice(SPLICES)
            case 4:
                raw[at:at] = raw[max(0, at - length) : at]
            case 5 if rng.random() < 0.3:
                del raw[at:]
            case 6:
                word = rng.choice(WORDS)
                raw[at : at + len(word)] = word
            case 7:
                other = rng.randrange(len(raw) + 1)
                raw[at : at + length] = raw[other : other + length]
            case 8 if at < len(raw):
                raw[at] = rng.choice(b'\n *9-E"\x00\x7f\x80\xff')
    return bytes(raw)


def shuffled_lines(content: bytes, rng: random.Random) -> bytes:
    """Lines lost, doubled, exchanged, repeated many times, or joined by strange ones."""
    lines = content.splitlines(keepends=True) or [b""]
    for _ in range(rng.randint(1, 4)):
        at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        match rng.randrange(6):
            case 0 if len(lines) > 1:
                del lines[at]
            case 1:
                lines.insert(other, lines[at])
            case 2:
                lines[at], lines[other] = lines[other], lines[at]
            case 3 if rng.random() < 0.3:
                lines[at:at] = [lines[at]] * min(
                    rng.choice([10, 1000, 20_000]), 1 + MAX_REPEATED // (1 + len(lines[at]))
                )
            case 4:
                lines.insert(at, rng.choice(SPLICES) + b"\n")
            case 5:
                lines[at] = damaged(lines[at], rng, 2)
    return b"".join(lines)


def encoded(content: bytes, rng: random.Random) -> bytes:
    """The same text in another encoding, or with other line ends."""
    text = content.decode("utf-8", "replace")
    forms: list[Callable[[], bytes]] = [
        lambda: text.encode("utf-16"),
        lambda: text.encode("utf-16-le"),
        lambda: text.encode("utf-32"),
        lambda: b"\xef\xbb\xbf" + content,
        lambda: content.replace(b"\n", b"\r\n"),
        lambda: content.replace(b"\n", b"\r"),
        lambda: content.replace(b" ", b"\xa0"),
        lambda: content.replace(b" ", "\u2003".encode()),
        lambda: content.replace(b"\n", b"\x0c\n"),
        lambda: content + b"\x1a",
        lambda: b"\x00" * len(content),
        lambda: b"",
    ]
    return rng.choice(forms)()


def text_damaged(content: bytes, rng: random.Random) -> bytes:
    """A text file, damaged in one way or another."""
    how = rng.choice([damaged, damaged, shuffled_lines, shuffled_lines, encoded])
    return how(content, rng)


def tree_damaged(tree: Any, rng: random.Random, deep: bool = False) -> tuple[Any, str]:
    """A document of dicts and lists with one place changed, and what was done."""
    places = list(_places(tree))
    if not places:
        return value(rng, deep), "all replaced"
    holder, key = rng.choice(places)
    match rng.randrange(6):
        case 0 | 1:
            holder[key] = value(rng, deep)
            done = f"{key} = {holder[key]!r:.60}"
        case 2:
            del holder[key]
            done = f"{key} removed"
        case 3:
            other, there = rng.choice(places)
            holder[key] = copy.deepcopy(other[there])
            done = f"{key} = that of {there}"
        case 4 if isinstance(holder, dict):
            name = rng.choice([str(key)[:-1], str(key) + "s", str(key).upper(), "", "__class__", "\n", "a" * 5000])
            holder[name] = holder.pop(key)
            done = f"{key} is called {name!r:.40}"
        case _:
            if isinstance(holder, list):
                holder.insert(int(key), value(rng, deep))
            else:
                holder[rng.choice(["extra", "path", "name", "x" * 300, "unit"])] = value(rng, deep)
            done = f"one more beside {key}"
    return tree, done


def _places(tree: Any, depth: int = 0) -> Any:
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, inner in list(items):
        yield tree, key
        if depth < 8:
            yield from _places(inner, depth + 1)
