# ruff: noqa: F401  (what is imported here, tests import from here)
"""How reports, tables, words and figures are shown, whatever result they are of."""

from diffthrust._support.figures import (  # private: what pages and commands draw with
    thinned,
    unseen,
)
from diffthrust._support.names import listing, nearest  # private: the words of many messages
from diffthrust._support.page import notebook_html  # private: the looks of all reports
from diffthrust._support.report import Report, Rows, Section, Styled  # private: what is shown
from diffthrust._support.results import report_of  # private: as data
from diffthrust._support.tables import plain_text, report_text  # private: the looks of all reports
from diffthrust._support.visible import in_line, visible  # private: what is tested
from diffthrust._support.words import (  # private: all tables' digits
    an,
    distinct_numbers,
    humanize,
    joined,
    number,
    with_error,
)
