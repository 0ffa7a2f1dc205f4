"""Guides that rank objectives otherwise than the objectives themselves do, at tau = 1."""

from edge_runtime.guidance.settings import Guide


def all_required(guide: Guide) -> Guide:
    """Correct preferences as if they were requirements: without limit, in one projected step with them."""
    guide.requirements = _corrected(guide)
    guide.preferences = guide.preference_weights = ()
    return guide


def all_preferred(guide: Guide) -> Guide:
    """Correct requirements as if they were preferences: within ``reach``, in a weighted sum with them."""
    guide.preferences = _corrected(guide)
    guide.preference_weights = tuple(guide.objectives[m].weight for m in guide.preferences)
    guide.requirements = ()
    return guide


def _corrected(guide: Guide) -> tuple[int, ...]:
    """All objectives that correct the finished action, by their places."""
    return tuple(sorted(guide.preferences + guide.requirements))
