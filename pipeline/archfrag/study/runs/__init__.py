"""The runs of a study: which ones a design asks for, where they are kept, who makes them."""
