"""Make plans by clicking, recording or driving."""
