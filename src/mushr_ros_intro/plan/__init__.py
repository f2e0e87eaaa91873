"""Read, find and write plan files."""
