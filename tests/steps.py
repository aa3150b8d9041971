# ruff: noqa: F401  (what is imported here, tests import from here)
"""Steps of a diagnosis by themselves: on states, results and errors that no log gives so exactly.

What a diagnosis decides is tested by what `dft.diagnose` returns; what stands here is held against
closed forms, or at the edge of a threshold.
"""

from diffthrust.diagnosis import (  # private: how a search begins
    _admission as admission_module,
)
from diffthrust.diagnosis import _effect_shares as effect_shares_module
from diffthrust.diagnosis import _mend_trials as mend_trials_module
from diffthrust.diagnosis import _pairs as pairs_module
from diffthrust.diagnosis import _residual_structure as residual_structure_module
from diffthrust.diagnosis import _rival_models as rival_models_module
from diffthrust.diagnosis import _screening as screening_module
from diffthrust.diagnosis import _search_start as search_start_module
from diffthrust.diagnosis import _search_state as search_state_module
from diffthrust.diagnosis import _stage_fit as stage_fit_module
from diffthrust.diagnosis import _trial_programs as trial_programs_module
from diffthrust.diagnosis._bounds import (  # private: of one stage
    idle_bounds,
    is_whole,
    stopped_by_bound,
    vanished_parameters,
)
from diffthrust.diagnosis._candidates import (  # private: without a search
    candidates_of,
    constants_in,
    constants_of,
    of_effect,
    place_words,
    places_of,
    with_candidates,
)
from diffthrust.diagnosis._changed_size import (  # private: in seconds
    ChangedSize,
    Size,
    changed_size,
)
from diffthrust.diagnosis._channel_use import (  # private: without a search
    models_fed_by,
    unused_channels,
    unused_notes,
)
from diffthrust.diagnosis._criteria import (  # private: each criterion alone
    criterion,
    missed,
    no_better,
    noises,
    simulation_errors,
    wald,
)
from diffthrust.diagnosis._effect_shares import shares_by_effect  # private: made by hand
from diffthrust.diagnosis._equivalence import (  # private: the rule alone, and on given trials
    near_over_whole_runs,
    refitted_rivals,
    told_apart,
    unrefuted,
    with_equivalents,
)
from diffthrust.diagnosis._explainable import (  # private: the regressions alone
    ErrorRecord,
    Rung,
    chosen,
    explainable,
    features_for,
    learners_for,
    pooled_sums,
    regression,
    ridge_solution,
    through_filters,
)
from diffthrust.diagnosis._explained_share import (  # private: the share and its interval
    BeforeAfter,
    Worth,
    explained_share,
    harms,
    matters,
    negligible,
    sure_share,
    surely_less,
)
from diffthrust.diagnosis._findings import (  # private: made by hand
    HeldValue,
    OddLog,
    OtherModel,
    Refusal,
    Stage,
    TriedEffect,
    verdict_evidence,
)
from diffthrust.diagnosis._headroom import (  # private: made by hand, and without a diagnosis
    ChannelHeadroom,
    Headroom,
    headroom_between,
    recurring_shares,
)
from diffthrust.diagnosis._innovations_fit import (  # private: as a diagnosis makes them
    CandidateFitter,
)
from diffthrust.diagnosis._learned import (  # private: a law without a diagnosis
    LearnedLaw,
    TriedForm,
)
from diffthrust.diagnosis._linear_response import project_out, score_test  # private: the test alone
from diffthrust.diagnosis._mended import MeasuredMend, mends_lead  # private: made by hand
from diffthrust.diagnosis._missing import (  # private: made by hand
    Missing,
    Remaining,
    SignalForm,
    after_effects,
)
from diffthrust.diagnosis._missing_signal import (  # private: against a known law
    NONE,
    LinearErrors,
    dependence_of,
    smoothed_signals,
)
from diffthrust.diagnosis._outcome import (  # private: a search that never ran, a bad fit
    untested,
    upheld,
)
from diffthrust.diagnosis._outlier_logs import (  # private: the test alone
    Slopes,
    deviations,
    no_longer_odd,
    odd_logs,
)
from diffthrust.diagnosis._periodic_stage import unexplained_line  # private: without a search
from diffthrust.diagnosis._predicted_gain import (  # private: worked out, not fitted
    added,
    edge_of,
    error_changes,
    predicted_gains,
    probes,
    shift_of,
)
from diffthrust.diagnosis._rating import (  # private: one step alone
    other_values,
    plainest_first,
    stopped,
    why_untestable,
)
from diffthrust.diagnosis._report.budget import (  # private: words and figures alone
    Wording,
    figures_in,
    within_budget,
    words_in,
)
from diffthrust.diagnosis._report.details import (  # private: one sentence alone
    missing_words,
    odd_words,
)
from diffthrust.diagnosis._report.error_text import growth_words  # private: each sentence alone
from diffthrust.diagnosis._report.figures import (  # private: each figure alone
    missing_figure,
    ranking_figure,
    stages_figure,
)
from diffthrust.diagnosis._report.learned import (  # private: a law's sentence alone
    form_words,
    own_effect,
)
from diffthrust.diagnosis._report.sections import (  # private: sentences alone, the page
    beginnings,
    caution_words,
    diagnosis_page,
)
from diffthrust.diagnosis._report.summary import (  # private: which error it tells
    channel_that_counts,
    raised_channel,
)
from diffthrust.diagnosis._report.tables import log_rows, worth_rows  # private: its cells
from diffthrust.diagnosis._report.text import (  # private: each sentence alone
    added_bound_words,
    an_effect,
    change_words,
    effect_words,
    parameter_words,
    sized_words,
    stage_words,
    verdict_words,
)
from diffthrust.diagnosis._residual_structure import (  # private: the basis of that law
    hats,
    knots_of,
    scores_at_port,
)
from diffthrust.diagnosis._screening import (  # private: the screen alone
    continued_beside,
    fitted_from_fallback,
    is_at_null,
    levels_of,
    promising_constants,
    screened,
)
from diffthrust.diagnosis._search_start import (  # private: trials without a diagnosis
    compiled_fitter,
    with_finer_steps,
)
from diffthrust.diagnosis._search_state import (  # private: trials without a diagnosis
    Clock,
    CurrentModel,
    FittedStage,
    Refit,
    SearchContext,
    SearchState,
)
from diffthrust.diagnosis._settings import SETTINGS  # private: what is held here
from diffthrust.diagnosis._simulation_fit import (  # private: without a diagnosis around them
    SimulationTrials,
    change_between,
    fitted_beside,
    fitted_to_runs,
)
from diffthrust.diagnosis._spectral_line import (  # private: spectra without a search
    height_at,
    height_over_turns,
    strongest_line,
)
from diffthrust.diagnosis._stage_fit import worth_between  # private: of two stages
from diffthrust.diagnosis._stepwise import (  # private: one step alone
    SCREENS,
    done,
    from_simulation,
    next_stage,
    ranked,
    refusing,
    runs_lead,
    step,
    still_refused,
)
from diffthrust.diagnosis._trial_programs import Programs  # private: as a diagnosis makes them
from diffthrust.diagnosis._unknown_term import (  # private: figures that no result shows
    evidence,
)
from diffthrust.diagnosis._unknown_term import fit as curve_fits
from diffthrust.diagnosis._unknown_term import form_fits as fitting
from diffthrust.diagnosis._unknown_term.closed_forms import (  # private: forms without a diagnosis
    FORMS,
    Match,
    as_estimated,
    as_formula,
    best_match,
    parameter_names,
    ranked_matches,
    with_companion,
)
from diffthrust.diagnosis._unknown_term.evidence import (  # private: evidence of one term
    with_jump,
)
from diffthrust.diagnosis._unknown_term.state_terms import (  # private: without a whole search
    library,
    state_terms,
)
from diffthrust.diagnosis._unknown_term.terms import (  # private: a part alone
    PortSeries,
    channel_of,
    regressors_of,
    term_along,
)
from diffthrust.diagnosis._verdict import far_above_noise, verdict_of  # private: from numbers alone
from diffthrust.estimation._fit import FitRuns  # private: made by hand
from diffthrust.simulation._commands import adopted  # private: the unit that a fit takes
from diffthrust.simulation._errors import ChannelError, Errors  # private: errors of no run
from diffthrust.simulation._record import bind  # private: logs as a fit reads them
