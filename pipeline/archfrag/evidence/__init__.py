"""What each method costs, how far it is off, and where it fails: measured, charted, told."""
