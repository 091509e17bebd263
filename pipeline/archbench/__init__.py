"""The laboratory beside archfrag: cost against error, growth, stability, corner cases, curves."""
