"""Judge recorded messages and replays."""
