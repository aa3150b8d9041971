"""Steps of a diagnosis by themselves: on states, results and errors that no log gives so exactly.

What a diagnosis decides is tested by what `dft.diagnose` returns; what stands here is held against
closed forms, or at the edge of a threshold.
"""

from diffthrust.diagnosis import (  # private: how a search begins
    _admission as admission_module,
)
from diffthrust.diagnosis import _beside_others as beside_others_module
from diffthrust.diagnosis import _mend_trials as mend_trials_module
from diffthrust.diagnosis import _pairs as pairs_module
from diffthrust.diagnosis import _residual_structure as residual_structure_module
from diffthrust.diagnosis import _rival_models as rival_models_module
from diffthrust.diagnosis import _screening as screening_module
from diffthrust.diagnosis import _search_start as search_start_module
from diffthrust.diagnosis import _trial_programs as trial_programs_module
from diffthrust.diagnosis._admission import worths_between  # private: of two stages
from diffthrust.diagnosis._bounds import (  # private: of one stage
    idle_bounds,
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
    wald,
)
from diffthrust.diagnosis._equivalence import (  # private: the rule alone, and on given trials
    near_over_whole_runs,
    told_apart,
    unrefuted,
    with_equivalents,
)
from diffthrust.diagnosis._exchange import refitted_rivals  # private: on given trials
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
    helps,
    matters,
    negligible,
    sure_share,
    surely_less,
)
from diffthrust.diagnosis._findings import (  # private: made by hand
    HeldValue,
    OddLog,
    Refusal,
    Stage,
    TriedEffect,
    headroom_between,
    verdict_evidence,
)
from diffthrust.diagnosis._headroom import (  # private: made by hand
    ChannelHeadroom,
    Headroom,
)
from diffthrust.diagnosis._innovations_fit import (  # private: as a diagnosis makes them
    CandidateFitter,
)
from diffthrust.diagnosis._learned import (  # private: a law without a diagnosis
    LearnedLaw,
    TriedForm,
)
from diffthrust.diagnosis._mended import (  # private: made by hand
    MeasuredMend,
    mends_lead,
)
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
from diffthrust.diagnosis._other_models import (  # private: made by hand
    OtherModel,
)
from diffthrust.diagnosis._outcome import (  # private: a search that never ran
    untested,
)
from diffthrust.diagnosis._outlier_logs import (  # private: the test alone
    Slopes,
    deviations,
    no_longer_odd,
    odd_logs,
)
from diffthrust.diagnosis._periodic_stage import (  # private: without a search
    unexplained_line,
)
from diffthrust.diagnosis._predicted_gain import (  # private: worked out, not fitted
    added,
    error_changes,
    predicted_gains,
    shift_of,
)
from diffthrust.diagnosis._probes import (  # private: points without a screen
    edge_of,
    probes,
)
from diffthrust.diagnosis._rating import (  # private: one step alone
    other_values,
    plainest_first,
    stopped,
    why_untestable,
)
from diffthrust.diagnosis._recurrence import recurring_shares  # private: its coverage
from diffthrust.diagnosis._report.budget import (  # private: words and figures alone
    Wording,
    figures_in,
    within_budget,
    words_in,
)
from diffthrust.diagnosis._report.effect_words import effect_words  # private: each effect alone
from diffthrust.diagnosis._report.error_text import (  # private: each sentence alone
    growth_words,
)
from diffthrust.diagnosis._report.figures import (  # private: each figure alone
    missing_figure,
    ranking_figure,
    stages_figure,
)
from diffthrust.diagnosis._report.learned import (  # private: a law's sentence alone
    form_words,
)
from diffthrust.diagnosis._report.own_effect import (  # private: a class without its page
    own_effect,
)
from diffthrust.diagnosis._report.remaining_text import (  # private: one sentence alone
    missing_words,
    odd_words,
)
from diffthrust.diagnosis._report.sections import (  # private: sentences alone, the page
    beginnings,
    caution_words,
    diagnosis_page,
)
from diffthrust.diagnosis._report.summary import (  # private: which error it tells
    channel_that_counts,
)
from diffthrust.diagnosis._report.tables import (  # private: its cells
    log_rows,
    worth_rows,
)
from diffthrust.diagnosis._report.text import (  # private: each sentence alone
    added_bound_words,
    an_effect,
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
from diffthrust.diagnosis._score_test import (  # private: the test alone
    project_out,
    score_test,
)
from diffthrust.diagnosis._screening import (  # private: the screen alone
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
from diffthrust.diagnosis._set_aside import (  # private: with a fit that ended badly
    upheld,
)
from diffthrust.diagnosis._settings import (  # private: what is held here
    SETTINGS,
)
from diffthrust.diagnosis._simulation_fit import (  # private: without a diagnosis around them
    change_between,
    fitted_beside,
    fitted_to_runs,
    simulation_fitter,
)
from diffthrust.diagnosis._spectral_line import (  # private: spectra without a search
    height_at,
    height_over_turns,
    strongest_line,
)
from diffthrust.diagnosis._stage_shares import (  # private: of stages made by hand
    shares_by_effect,
)
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
from diffthrust.diagnosis._trial_programs import (  # private: as a diagnosis makes them
    Programs,
)
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
    form_values,
    ranked_matches,
    with_companion,
)
from diffthrust.diagnosis._unknown_term.jumps import (  # private: evidence of one term
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
from diffthrust.diagnosis._verdict import (  # private: from numbers alone
    far_above_noise,
    verdict_of,
)
from diffthrust.estimation._fit import FitRuns  # private: made by hand
from diffthrust.simulation._commands import (  # private: the unit that a fit takes
    adopted,
)
from diffthrust.simulation._errors import (  # private: errors of no run
    ChannelError,
    Errors,
)
from diffthrust.simulation._record import (  # private: logs as a fit reads them
    bind,
)

__all__ = [
    "FORMS",
    "NONE",
    "SCREENS",
    "SETTINGS",
    "BeforeAfter",
    "CandidateFitter",
    "ChangedSize",
    "ChannelError",
    "ChannelHeadroom",
    "Clock",
    "CurrentModel",
    "ErrorRecord",
    "Errors",
    "FitRuns",
    "FittedStage",
    "Headroom",
    "HeldValue",
    "LearnedLaw",
    "LinearErrors",
    "Match",
    "MeasuredMend",
    "Missing",
    "OddLog",
    "OtherModel",
    "PortSeries",
    "Programs",
    "Refit",
    "Refusal",
    "Remaining",
    "Rung",
    "SearchContext",
    "SearchState",
    "SignalForm",
    "Size",
    "Slopes",
    "Stage",
    "TriedEffect",
    "TriedForm",
    "Wording",
    "Worth",
    "added",
    "added_bound_words",
    "admission_module",
    "adopted",
    "after_effects",
    "an_effect",
    "as_estimated",
    "as_formula",
    "beginnings",
    "beside_others_module",
    "best_match",
    "bind",
    "candidates_of",
    "caution_words",
    "change_between",
    "changed_size",
    "channel_of",
    "channel_that_counts",
    "chosen",
    "compiled_fitter",
    "constants_in",
    "constants_of",
    "criterion",
    "curve_fits",
    "dependence_of",
    "deviations",
    "diagnosis_page",
    "done",
    "edge_of",
    "effect_words",
    "error_changes",
    "evidence",
    "explainable",
    "explained_share",
    "far_above_noise",
    "features_for",
    "figures_in",
    "fitted_beside",
    "fitted_from_fallback",
    "fitted_to_runs",
    "fitting",
    "form_values",
    "form_words",
    "from_simulation",
    "growth_words",
    "harms",
    "hats",
    "headroom_between",
    "height_at",
    "height_over_turns",
    "helps",
    "idle_bounds",
    "is_at_null",
    "knots_of",
    "learners_for",
    "levels_of",
    "library",
    "log_rows",
    "matters",
    "mend_trials_module",
    "mends_lead",
    "missed",
    "missing_figure",
    "missing_words",
    "models_fed_by",
    "near_over_whole_runs",
    "negligible",
    "next_stage",
    "no_better",
    "no_longer_odd",
    "noises",
    "odd_logs",
    "odd_words",
    "of_effect",
    "other_values",
    "own_effect",
    "pairs_module",
    "parameter_words",
    "place_words",
    "places_of",
    "plainest_first",
    "pooled_sums",
    "predicted_gains",
    "probes",
    "project_out",
    "promising_constants",
    "ranked",
    "ranked_matches",
    "ranking_figure",
    "recurring_shares",
    "refitted_rivals",
    "refusing",
    "regression",
    "regressors_of",
    "residual_structure_module",
    "ridge_solution",
    "rival_models_module",
    "runs_lead",
    "score_test",
    "scores_at_port",
    "screened",
    "screening_module",
    "search_start_module",
    "shares_by_effect",
    "shift_of",
    "simulation_fitter",
    "sized_words",
    "smoothed_signals",
    "stage_words",
    "stages_figure",
    "state_terms",
    "step",
    "still_refused",
    "stopped",
    "stopped_by_bound",
    "strongest_line",
    "sure_share",
    "surely_less",
    "term_along",
    "through_filters",
    "told_apart",
    "trial_programs_module",
    "unexplained_line",
    "unrefuted",
    "untested",
    "unused_channels",
    "unused_notes",
    "upheld",
    "vanished_parameters",
    "verdict_evidence",
    "verdict_of",
    "verdict_words",
    "wald",
    "why_untestable",
    "with_candidates",
    "with_companion",
    "with_equivalents",
    "with_finer_steps",
    "with_jump",
    "within_budget",
    "words_in",
    "worth_rows",
    "worths_between",
]
