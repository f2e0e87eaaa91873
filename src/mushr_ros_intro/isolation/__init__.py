"""Run a node that is not trusted, and observe it: files, system calls, memory, threads."""
