"""How work is done: child processes, files, interrupts, progress."""
