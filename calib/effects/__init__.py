"""Effects that come with calib, one a file."""
