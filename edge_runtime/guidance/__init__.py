"""Steering the flow: settings, projections, and `flow`, the method on one page."""
