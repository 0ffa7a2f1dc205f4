"""Episodes of a task: what robots hear of each other, who decides, and what satisfies."""
