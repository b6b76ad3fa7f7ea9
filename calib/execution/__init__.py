"""How work is done: child processes, files written whole, interrupts, progress."""
