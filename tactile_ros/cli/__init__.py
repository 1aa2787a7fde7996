"""The command `tactile`: one file per command."""
