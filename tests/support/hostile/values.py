"""Values that no file should hold, and changes of files that hold others."""

import copy
import json

TEXTS = [
    "", " ", "a" * 10_000, "\x1b[2J\r", "a\0b", "$\\frac{", "../../etc/passwd", "/dev/zero", "~nobody/x",
    "\u202e", "\ud83d\ude00", "<script>", "os:system", "numpy", "NaN", "Infinity", "-1", "{}", "[", "%s%n",
]  # fmt: skip
NUMBERS = [
    0, 1, -1, 2, 255, 257, 2**31, -(2**31), 2**53 + 1, 2**63 - 1, 2**63, 10**30, -(10**30), 10**400,
    0.0, -0.0, 0.5, 5e-324, 1e-200, 1e-9, 1e9, 1e155, 1e300, -1e300,
    float("nan"), float("inf"), float("-inf"),
]  # fmt: skip
OTHERS = [None, True, False, [], {}, [[]], [[[[]]]] * 50, {"a": {"b": {}}}, [0] * 5000, "deep"]


def value(draw):
    return copy.deepcopy(draw.choice(draw.choice([TEXTS, NUMBERS, NUMBERS, OTHERS])))


def another(draw, held):
    """Another value of the same kind."""
    if isinstance(held, bool):
        return not held
    if isinstance(held, int) and draw.random() < 0.5:
        return draw.choice([number for number in NUMBERS if isinstance(number, int)])
    if isinstance(held, int | float):
        return draw.choice([float(number) for number in NUMBERS if abs(number) < 1e301])
    return draw.choice(TEXTS) if isinstance(held, str) else value(draw)


def places(tree, path=()):
    """Every place of a tree of dicts and lists, from the root on."""
    yield path
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for key, item in list(items):
        yield from places(item, (*path, key))


def change_tree(draw, tree, times=1):
    """Change a tree of dicts and lists in so many places; returns it."""
    for _ in range(times):
        inner = [path for path in places(tree) if path]
        if not inner and not isinstance(tree, dict):
            return value(draw)
        *parents, last = draw.choice(inner or [("new",)])
        node = tree
        for key in parents:
            node = node[key]
        held = node.get(last) if isinstance(node, dict) else node[last]
        match draw.randrange(12):
            case 0 if len(node) > 1:
                del node[last]
            case 1 if isinstance(node, list):
                node.extend(copy.deepcopy(held) for _ in range(draw.choice([1, 10, 300])))
            case 2 if isinstance(node, dict):
                node[draw.choice(TEXTS)] = value(draw)
            case 3 | 4:
                node[last] = value(draw)
            case _:
                node[last] = another(draw, held)
    return tree


def as_json(draw, tree):
    """A tree as JSON, now and then with lists a hundred thousand deep."""
    depth = draw.choice([100, 2000, 100_000])
    text = json.dumps(tree).replace('"deep"', "[" * depth + "]" * depth)
    return text.encode("utf-8", "replace")


def change_bytes(draw, content):
    """Change bytes of a file: a few, a stretch, its end."""
    content = bytearray(content)
    if not content:
        return bytes(content)
    at = draw.randrange(len(content))
    match draw.randrange(5):
        case 0:
            del content[at:]
        case 1:
            del content[at : at + draw.randrange(1, 50)]
        case 2:
            content[at:at] = content[at : at + draw.randrange(1, 500)] * draw.choice([1, 3, 100])
        case 3:
            content[at : at + 8] = draw.choice([0, 1, 2**31, 2**63 - 1, 2**64 - 1]).to_bytes(8, "little")
        case _:
            for _ in range(draw.randrange(1, 6)):
                content[draw.randrange(len(content))] = draw.randrange(256)
    return bytes(content)
