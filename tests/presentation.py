# ruff: noqa: F401  (what is imported here, tests import from here)
"""How reports, tables, words and figures are shown, whatever result they are of."""

from diffthrust._support.figures import (  # private: what pages and commands draw with
    thinned,
    unseen,
)
from diffthrust._support.names import (  # private: the words of many messages
    listing,
    nearest,
)
from diffthrust._support.page import (  # private: the looks of all reports
    notebook_html,
)
from diffthrust._support.report import (  # private: what is shown
    Report,
    Rows,
    Section,
    Styled,
)
from diffthrust._support.results import (  # private: as data
    report_of,
)
from diffthrust._support.tables import (  # private: the looks of all reports
    plain_text,
    report_text,
)
from diffthrust._support.visible import (  # private: what is tested
    in_line,
    visible,
)
from diffthrust._support.words import (  # private: all tables' digits
    an,
    distinct_numbers,
    humanize,
    joined,
    number,
    with_error,
)
