"""The table of bridges names modules that exist and offer what they are asked for."""

import importlib

import pytest

from edge_runtime.run.bridges import BRIDGES


@pytest.mark.parametrize("name", BRIDGES)
def test_every_module_offers_what_it_is_named_for(name):
    modules = BRIDGES[name]
    offered = {
        modules.bridge: ("add_arguments", "options_from", "open_bridge"),
        modules.checks: ("examine_link",),
        modules.guard_link: ("make_link",),
    }
    for module, functions in offered.items():
        if module:
            assert all(callable(getattr(importlib.import_module(module), function)) for function in functions)


def test_whatever_is_no_simulation_is_guarded_and_checked():
    for modules in BRIDGES.values():
        assert bool(modules.guard_link) == bool(modules.checks) == (not modules.simulated)
