"""Foreign files are read and worked on in processes with limits of time and memory."""
