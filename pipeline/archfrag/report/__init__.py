"""One offline page of what a study found and how it was found."""
