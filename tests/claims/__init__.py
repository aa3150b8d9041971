"""The sentences of a summary as claims: each is parsed, and held against what it says.

A summary is read from its beginning; at each place a claim must match, or the sentence is one
that nobody checks, and that is an error. A claim is held against the object's numbers, worked
out anew from its runs, and against a `Page`: the same logs and equations in `reference.whole_runs`,
and what is known of the plant.

    wrong = claims.contradictions(diag, page)         # [] where every sentence is so
"""

from . import about_effects as about_effects
from . import about_errors as about_errors
from . import about_logs as about_logs
from . import about_summary as about_summary
from .page import Page as Page
from .parsing import contradictions as contradictions
