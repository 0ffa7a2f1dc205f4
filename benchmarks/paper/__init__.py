"""The paper's evaluation, re-made by the deployed runtime: tables, figures, and what lies beyond them."""
