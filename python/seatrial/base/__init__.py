"""What every room stands on: errors, arrays and channels, rotation, frames, units, files, runs, progress."""
