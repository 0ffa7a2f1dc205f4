"""The paper's case study: Navigation by robots on wheels that slip."""
