"""Guides that rank objectives otherwise than the objectives themselves do, at tau = 1."""

from msgspec.structs import replace

from edge_runtime.guidance.guide import Guide


def all_required(guide: Guide) -> Guide:
    """Correct preferences as if they were requirements: without limit, in one projected step with them."""
    return replace(guide, preferences=(), requirements=_corrected(guide))


def all_preferred(guide: Guide) -> Guide:
    """Correct requirements as if they were preferences: within ``reach``, in a weighted sum with them."""
    return replace(guide, preferences=_corrected(guide), requirements=())


def _corrected(guide: Guide) -> tuple[int, ...]:
    """All objectives that correct the finished action, by their places."""
    return tuple(sorted(guide.preferences + guide.requirements))
