"""Runs a scenario: starts everything, follows the timeline, ends everything."""
