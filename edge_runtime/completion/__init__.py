"""Shell completion of every command."""
