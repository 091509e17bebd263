"""The process that reads files by readers in C: ``python -m archfrag.motions.formats.apart``."""

from archfrag.motions.formats import read_in_c
from archfrag.system import answer_requests

if __name__ == "__main__":
    answer_requests(read_in_c)
