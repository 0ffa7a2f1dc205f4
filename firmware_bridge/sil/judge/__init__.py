"""From what a run left behind to figures and a verdict."""
