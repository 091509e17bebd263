"""One offline page that tells what a study found and how it was found."""
