"""Grade many submissions, and write the results."""
