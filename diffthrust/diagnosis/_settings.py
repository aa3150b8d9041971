"""The numbers by which a diagnosis decides: what each decides, its origin, what breaks beside it.

They are grouped by step. "Chosen" says that nobody has derived the number; how far it can move
before a decision on sets of the bench changes, docs/numbers/thresholds.md shows. Numbers that only
steer an algorithm (steps of a search, grids, tolerances) stand beside it.

References: Schwarz 1978, Annals of Statistics 6, 461; Künsch 1989, Annals of Statistics 17, 1217;
Kass and Raftery 1995, JASA 90, 773, section 3.2; Schuster 1898, Terrestrial Magnetism 3, 13.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Screening:
    """Which candidates are worth a fit, by what the linear response of the errors promises."""

    most_fitted: int = 8
    """The number of effects that are fitted at each stage, and of constants: those that promise
    most.
    Origin: as many effects as the trials compile into one program over longer logs. Lower: the
    right one may not be tried, and its rivals are not listed. Higher: a second program, minutes for
    a vessel."""
    least_share_of_price: float = 0.5
    """A candidate is fitted if it promises this share of the likelihood ratio that adding it costs.
    Origin: chosen, a factor of two for an effect whose response bends. Lower: fits that come to
    nothing. Higher: faint effects with a bent response are never fitted."""
    least_share_of_best: float = 0.005
    """It must also promise this share of what the best does.
    Origin: chosen; 0.02 until promises were worked out from the errors that an effect leaves.
    Lower: fits that a stage does not use. Higher: of two hidden effects the smaller is looked at
    one stage later."""
    least_promise: float = 2.0
    """Likelihood ratio that a probe must promise to be followed.
    Origin: chosen; noise promises as much in one case of six (chi-square, one degree of freedom).
    Lower: searches from probes of noise. Higher: searches that begin on a flat slope are not
    begun."""
    threshold_promise: float = 0.1
    """If no probe next to the null promises this, the effect may have a threshold: its weakest
    probe that acts is followed.
    Origin: chosen; a smooth effect promises less by chance in one case of four, one with a
    threshold promises nothing. Lower: dead bands under noise are missed. Higher: long searches for
    smooth effects."""
    least_early_gain: float = 3.0
    """Likelihood ratio that must be in sight after a few steps of a fit, or it ends.
    Origin: chosen; noise gains as much in one case of twelve, and an addition takes log N + 4, some
    12. Lower: fits that come to nothing. Higher: searches that creep are given up."""
    most_carried: int = 6
    """The number of fitted candidates that are carried to the optimum, the most promising first.
    Origin: chosen. Lower: the best may be one that was not carried on. Higher: a longer stage."""
    pricing_level: float = 0.05
    """A candidate is priced with the noise it makes superfluous if noise would gain as much by
    itself no more often than this.
    Origin: the customary 5 % of one test. Lower: an effect that stands for a random force is
    overlooked. Higher: pricing, several fits each, is spent on chance."""


@dataclass(frozen=True)
class Admission:
    """Whether the best candidate is added to the model."""

    least_bic_gain: float = 4.0
    """An effect is added if it lowers the Bayesian information criterion by more than this, and by
    twice the logarithm of how many times more candidates there are than ``priced_candidates``.
    Origin: Schwarz charges log N, for one effect; 4 more is the price of the best of some thirty: a
    chi-square of one degree of freedom exceeds log N + 4 in 4.5e-4 (N = 4000) to 1.9e-4 (20 000) of
    cases, the largest of thirty in 1.4 to 0.6 %. Lower: at 0 false alarms in 12 to 5 %. Higher: at
    8 a tenth of the alarms, and effects between are missed."""
    priced_candidates: int = 30
    """So many candidates are paid for by ``least_bic_gain``.
    Origin: as said there; a thruster has 24, a vessel 15, a craft of eight thrusters 103, of which
    one held constant was "another" at 3.6 standard errors. Lower: small effects are missed. Higher:
    false ones where candidates are many."""
    tied_bic: float = 2.0
    """Of candidates whose criteria are this close, that of fewest parameters comes first.
    Origin: below 2, evidence is not worth more than a bare mention (Kass & Raftery 1995, section
    3.2). Lower: one of eight thrusters that is weak by a fifth is told as one that lost it a moment
    before the log began, by 0.9. Higher: an effect gives way that the logs do tell apart."""
    clear_bic_gain: float = 20.0
    """If the criterion falls by more, the noise an effect makes superfluous is not priced.
    Origin: a noise with a gain and a memory costs 2 log N, 17 (N = 4000) to 20 (20 000): one noise
    more or less does not undo the decision. Lower: effects are judged without the noise they
    replace. Higher: fits that decide nothing."""
    plain_bic_gain: float = 200.0
    """A gain beyond doubt: not called redundant, and not the gain of a better noise.
    Origin: chosen, ten times the clear gain, because both tests are linear and fail far from the
    null. Lower: the gain of a better noise is taken for an effect's. Higher: an effect that others
    imitate only near the null is called untestable."""
    certain_noise: float = 10.0
    """A noise stays without a fit that takes it out if Wald's statistic of its gains is this
    multiple of its price.
    Origin: chosen, an allowance for the quadratic; such fits were a third of the steps of a
    vessel's diagnosis. Lower: a noise stays that is not worth its price. Higher: those steps."""
    least_share_of_unknown: float = 0.3
    """Reject an effect that explains less than this share of what a curve of one signal gains.
    Origin: chosen. Lower: something outside the catalogue gets the name of an effect that touches
    the same signal. Higher: a right effect is refused where something else is missing as well."""
    least_share_kept: float = 0.5
    """Accept it all the same if this share of its gain remains beside that curve.
    Origin: chosen; the larger part of the gain is then its own. Lower: effects that imitate the
    curve are added. Higher: of two that are missing the smaller is refused."""
    most_unseen_loss: float = 3.0
    """A noise that costs the unseen logs more log-likelihood is not taken for a better one.
    Origin: odds of 20 to 1 (e^3). Lower: logs that differ a little bar a better noise. Higher: the
    noise follows the training logs."""
    most_unseen_growth: float = 1.2
    """Reject an effect with which the error of whole unseen runs grows by more than this factor.
    Origin: chosen. Lower: right effects are refused for one log under random forces. Higher:
    effects are added that fail on logs they were not fitted to."""
    most_joint_growth: float = 1.01
    """The same of unseen and training runs together (the product of both growths).
    Origin: an effect fitted to whole runs cannot do worse on them; 1 % for where fits end, chosen.
    Lower: refusals by where a fit ended. Higher: effects that predict a sample better and whole
    runs worse."""
    most_effects: int = 8
    """No more effects are added, or called detectable.
    Origin: a bench with six of them (latency, dead band, saturation, sag, weaker thrust astern, and
    a tare). Lower: with five, its tare was missed, and the weaker thrust took its place. Higher: a
    search whose every effect is a false one takes longer to end."""


@dataclass(frozen=True)
class WholeRuns:
    """What an effect is worth over whole simulated runs, and when whole runs support it."""

    negligible_share: float = 0.03
    """An effect that removes no more of the squared whole-run error is detectable and not added.
    Origin: chosen; 3 % of the squares is 1.5 % of the error. Lower: effects are added that no plot
    shows. Higher: faint effects are only detectable."""
    one_channel_share: float = 0.1
    """It is added all the same if it surely removes more than this of one channel's squared error,
    and harms no other channel.
    Origin: the tenth that counts as a change of a channel; 0.2 until the other channels were asked.
    Lower: one channel of several does so by chance. Higher: what acts on one sensor drowns in the
    errors of channels that nothing explains."""
    interval_level: float = 0.9
    """Level of a share's interval, which must lie above zero.
    Origin: 5 % on its one side, customary. Lower: more worthless effects pass. Higher: three logs
    give no interval that excludes zero."""
    block_length: float = 2.0
    """Length of a block of the bootstrap, over the time for which errors last (integral time).
    Origin: Künsch; of exponentially correlated errors blocks of n integral times miss about 1/(2 n)
    of the variance: a quarter at 2, intervals are 13 % too narrow. Lower: at 1 by 25 %. Higher: at
    4 by 6 %, from half as many blocks."""
    fewest_blocks: int = 4
    """Smallest number of blocks of a log, however long its errors last.
    Origin: chosen; four blocks have 35 distinct draws. Lower: three have 10. Higher: blocks shorter
    than errors last."""
    most_blocks: int = 24
    """Largest number of blocks of a log.
    Origin: the scatter of 24 blocks is known to 15 % (1 / sqrt(2 * 23)). Lower: rougher intervals.
    Higher: time."""
    proving_share: float = 0.1
    """An effect that surely removes more of the squared error of whole unseen runs need not predict
    their next sample better.
    Origin: chosen. Lower: a random force that happens to repeat proves an effect. Higher: what acts
    slowly is refused because one sample does not show it."""
    equivalent_error: float = 1.1
    """Explanations with which whole runs err by no more than this factor are equally good.
    Origin: the tenth that the bench allows a learned law. Lower: noise decides between names.
    Higher: wrong names are offered, and a law that is behind is fitted on."""
    most_possible: int = 4
    """The number of effects, and of constants, that whole runs alone support and that are tried
    again and listed.
    Origin: chosen, a list to plan a test by. Lower: the right one may be missing. Higher: more
    trials that random forces win."""
    mending_share: float = 0.1
    """Undoing a mistake of the logs leads a summary if it surely removes more of the squared error.
    Origin: chosen; a twentieth of the error. On BlueBoat's logs an exchange of left and right
    removes 24 %. Lower: a sign that does next to nothing stands first. Higher: an exchange that one
    channel of three shows is passed over."""
    most_mends: int = 3
    """The number of readings of doubted channels to which the model is fitted.
    Origin: chosen; each is a fit of whole runs from several starts. Lower: of the sign of one
    channel and the exchange of two others only one is tried. Higher: minutes for logs with many
    doubts."""
    most_user_effects: int = 3
    """The number of a user's effects without any promise that are fitted to whole runs all the
    same.
    Origin: chosen; each takes a fit from several starts. Lower: a model wrong at heart hides what a
    user expects. Higher: minutes."""


@dataclass(frozen=True)
class Pairs:
    """Which effects are fitted to whole runs where one-step errors support none."""

    most_effects: int = 8
    """The number of effects of which pairs are made: the best single, those that one-step errors
    cannot test, and further singles.
    Origin: as many as the trials compile into one program over longer logs. Lower: the second of a
    pair is not among them. Higher: a second program, minutes for a vessel."""
    most_fitted: int = 3
    """The number of pairs that are fitted to the end, those of least cost first.
    Origin: chosen; each takes a fit of whole runs, half a minute for a boat. Lower: the pair that a
    few steps put second is not fitted. Higher: minutes where no pair helps."""
    least_single_share: float = 0.5
    """A single effect that one-step errors do not support at all is added if it surely removes more
    of the squared error of whole runs, over unseen logs and over all.
    Origin: 12 regressors that have nothing to do with the errors, one of them chosen by one unseen
    log: at 0.1 on that log alone 29 % of 150 sets had a false one beside errors of a memory of a
    third of a log, at 0.5 on both 1 %. Lower: such imitations. Higher: a quadratic drag of a boat
    that turns, which removes 94 %, is still added, and less is not."""


@dataclass(frozen=True)
class Equivalence:
    """Which effects these logs cannot tell apart."""

    most_bic_apart: float = 8.0
    """Effects whose criteria differ by less are of one group.
    Origin: odds of 55 to 1 (e^4), between strong (6) and very strong (10) in Kass and Raftery.
    Lower: at 4, odds of 7, the right effect is often left out. Higher: at 16, odds of 3000, groups
    name nothing."""
    least_share_of_gain: float = 0.05
    """A rival is fitted in the place of an effect only if it promises this share of the likelihood
    ratio that the effect gains.
    Origin: chosen, an eighth of the least that any of 17 rivals promised that ended as near, on
    pairs of a bench that are alike; of 180 that were fitted it leaves out 103. Lower: fits that
    cannot come near, a quarter of a diagnosis of five effects. Higher: a rival whose response bends
    is not named."""
    hopeless_bic: float = 100.0
    """A rival that is so far behind after a few steps is not fitted on.
    Origin: chosen, a dozen times what it has to reach. Lower: a search that creeps is cut off.
    Higher: time."""
    least_share_of_effect: float = 0.9
    """Rivals that surely remove less than this share of what an effect surely removes are told from
    it.
    Origin: chosen, the tenth by which errors count as equal. Lower: rivals that do less of the
    work. Higher: noise in the parameters separates equals."""
    near_error: float = 1.2
    """Rivals with which whole runs erred by no more than this factor when the effect was added are
    fitted from several starts in its place in the last stage.
    Origin: twice the tenth by which errors count as equal, for trials have coarse steps and one
    start: a linear damping, as good as the load exponent of a T200, was 1.13 times behind.
    Lower: rivals that are as good in the end are not asked. Higher: minutes, for none."""
    most_compared: int = 4
    """The number of rivals of an effect that are held against whole runs in its place, the nearest
    by one-step errors first.
    Origin: chosen; each takes a fit of whole runs. Lower: the right one may not be among them.
    Higher: minutes, for groups that name nothing."""
    most_named: int = 2
    """The number of these rivals that are named.
    Origin: with the effect three, the largest group the bench takes for an answer. Lower: the right
    one may be missing. Higher: groups name nothing."""


@dataclass(frozen=True)
class VerdictRule:
    """What the whole-run errors of the last model say."""

    far_above_one_step: float = 4.0
    """Whole-run errors lie far above those from one sample to the next from this factor on.
    Origin: chosen; then 94 % of the squared error (1 - 1/16) has built up along the run. Lower: at
    2 (75 %) lasting errors of a sensor are enough. Higher: what builds up passes as adequate."""
    least_nrmse: float = 0.05
    """Smaller whole-run errors, over what the channel does (NRMSE), are never far.
    Origin: chosen; 0.1 until noise that a log states was counted. Lower: quiet sensors make errors
    of no interest undecided. Higher: visible errors are adequate."""
    repeating_share: float = 0.25
    """Errors repeat if a flexible model surely explains more of their squares.
    Origin: chosen; 0.1 for a day. Lower: random forces that a few runs share count as structure.
    Higher: a law that is missing leaves the verdict undecided."""
    changed_share: float = 0.25
    """A found effect changes its size if that surely removes more of the squared whole-run error.
    Origin: chosen, as what repeats; see the false alarms in tests/diagnosis/test_changed_size.py.
    Lower: random forces that logs share are told as a change. Higher: a change is called unknown.
    """
    repeated_input: float = 0.05
    """Two logs repeat their inputs where these differ by no more of what they do.
    Origin: chosen; commands as logged twice differ by their rounding, a driver's by tens of per
    cent. Lower: repeats that a test engineer meant are not seen. Higher: errors of other inputs are
    compared, and what the inputs make counts as a disturbance."""


@dataclass(frozen=True)
class Structure:
    """Whether the one-step errors still depend on a signal, and on which."""

    false_alarms: float = 0.01
    """Share of sound sets in which a signal at a port is found, all tests together.
    Origin: Bonferroni; in 60 blind sets with nothing hidden (seeds 1501, 1601) no law was learned.
    Lower: small laws outside the catalogue are missed. Higher: this share of diagnoses is wrongly
    unexplained."""
    least_share: float = 0.01
    """Structure must explain this share of the squared one-step errors.
    Origin: two ways to integrate the same physics differ by as much. Lower: integrators are
    reported as structure. Higher: laws that act in a small share of a run are missed."""
    naming_level: float = 0.05
    """Once structure is proven, the largest that passes this level by itself is reported.
    Origin: the customary 5 % of one test. Lower: of correlated signals the surest is reported, not
    the one that explains most. Higher: one that is large by chance."""
    knots: int = 7
    """The number of values of a function of unknown form, which is straight between them.
    Origin: chosen; each costs log N. Lower: humps are cut off. Higher: each test has more degrees
    of freedom to pay for."""
    blocks: int = 48
    """The number of blocks of time of each log over which the scatter of the gradient is taken.
    Origin: of two logs the F-test of seven values at 1e-4 then asks for 2 % more than chi-square.
    Lower: 8 % at 12 blocks. Higher: blocks shorter than errors last, and false alarms."""
    fewest_blocks: int = 3
    """Structure that shows in fewer blocks of time is never significant.
    Origin: two blocks leave one degree of freedom, Cauchy's distribution. Lower: a single event
    decides. Higher: what acts in one manoeuvre only is ignored."""
    least_waves: float = 4.0
    """The smallest number of waves over the range of a position that is looked for.
    Origin: the six straight pieces of a function follow three waves at most. Lower: curves are
    reported as ripples. Higher: ripples that neither finds."""
    wave_power: float = 10.0
    """A wave is tried if its power exceeds log n, the largest of n powers of white errors, by this.
    Origin: these are exponential (Schuster): the largest exceeds it with e^-10, 5e-5. Lower: tests
    of noise, for all of which the false alarms are divided. Higher: faint ripples are missed."""
    dependence_level: float = 0.05
    """False alarms of a dependence of the missing signal, over all signals at a port together.
    Origin: the customary 5 %; no verdict depends on it. Lower: dependences are not drawn. Higher:
    chance is."""
    least_dependence_share: float = 0.01
    """A dependence must explain this share of the missing signal's variance.
    Origin: chosen. Lower: curves that look flat are drawn. Higher: a dependence under strong noise
    is not."""
    signal_over_error: float = 1.5
    """A missing signal without a dependence is reported from this multiple of its standard error
    on.
    Origin: chosen. Lower: smoothed noise is reported. Higher: missing signals are not."""


@dataclass(frozen=True)
class OutlierLogs:
    """Which logs disagree with the others."""

    false_alarms: float = 0.01
    """Share of sets of sound logs in which some parameter of some log is reported to differ.
    Origin: Bonferroni over logs and parameters. Lower: a log of another plant passes. Higher: this
    share of sound sets loses a log."""
    blocks: int = 24
    """Blocks of time of each log whose scatter tells how sure its gradient is.
    Origin: of three logs the t-test at 1e-4 then asks for 6 % more than a normal. Lower: less
    power. Higher: blocks shorter than errors last, and false alarms."""
    fewest_logs: int = 3
    """The smallest number of logs among which one can deviate.
    Origin: of two each disagrees with the other. Lower: has no meaning. Higher: three logs are not
    judged."""
    most_error_left: float = 0.9
    """With parameters of its own a log's squared whole-run error must fall to this share.
    Origin: chosen; a twentieth of the error. Lower: logs of a worn plant pass. Higher: differences
    are reported that are certain and do not matter."""
    least_error_ratio: float = 1.5
    """The error of a log is reported from this multiple of that of the median log on.
    Origin: chosen. Lower: harder manoeuvres are called odd. Higher: a log counts as sound again
    beside a law that explains half of what was odd."""
    least_time_beyond: float = 0.2
    """A log that is for this share of its time where half of the others are not is not accused.
    Origin: chosen; between the hundredth that a rich log spends there by chance and the half of a
    run that goes both ways among runs ahead. Lower: one manoeuvre excuses a fault. Higher: what
    the model lacks astern is taken for a fault of the astern run."""
    decisive_share: float = 1 / 3
    """An odd log that carries more of a channel's squared error may decide all, and is set aside.
    Origin: the fair share of one log of three. Lower: evidence is given up for little. Higher: all
    is judged by a log that is not of this plant."""


@dataclass(frozen=True)
class HeadroomRule:
    """How much any flexible model could explain."""

    least_samples: int = 100
    """Fewer samples teach no correction.
    Origin: as many as a correction has random features. Lower: intervals of an overfit. Higher:
    slow sensors are not judged."""
    worthwhile_share: float = 0.1
    """A share of the squared error that is surely below this is not worth a search.
    Origin: chosen; a twentieth of the error. Lower: searches are advised for nothing. Higher:
    errors that matter are called noise."""
    least_independent: float = 30.0
    """Where a state is not measured, errors of fewer independent samples exclude no share.
    Origin: two tanks, one log to learn from, the errors as 10 to 20 independent samples: a
    correction explained 0 % (0 % to 19 %) where physics removes 84 %. Lower: too little to learn
    from passes as nothing to find. Higher: logs that show that nothing repeats tell nothing."""
    tie_loss: float = 0.02
    """Forms whose squared errors on left-out records are so near to the best may be the right one.
    Origin: chosen. Lower: intervals miss what a richer form would explain. Higher: they are as wide
    as the poorest form's."""
    least_rung_gain: float = 0.01
    """A richer form must remove this share more of the squared error.
    Origin: chosen; a tie goes to the plainer one. Lower: noise chooses. Higher: small bends are
    left out."""
    interval_width: float = 1.895
    """Standard deviations on either side of a 90 % interval.
    Origin: Student's t of seven degrees: the scatter comes from a few stretches of errors that
    last. Lower: 1.645 is right for a known scatter only. Higher: nothing surely repeats."""


@dataclass(frozen=True)
class UnknownTerm:
    """Which law of unknown form is fitted to whole runs, and reported."""

    least_evidence: float = 10.0
    """A law with less evidence (log of the marginal likelihood ratio) is not fitted.
    Origin: odds of 22 000 to 1 (e^10), for the likeliest of some hundred laws. Lower: fits to
    noise. Higher: faint laws stay structure without a form."""
    most_multiplied: int = 8
    """The number of likeliest laws whose signals are tried times another signal.
    Origin: chosen. Lower: laws that show only as products are missed. Higher: time."""
    sharpened_evidence: float = 0.6
    """The memory of a law is estimated from this share of the greatest evidence on.
    Origin: chosen, for what a first guess of a memory loses. Lower: time. Higher: a law loses by
    its first guess."""
    indifferent_evidence: float = 1.0
    """Of laws whose evidence differs by no more the plainest is first.
    Origin: odds of e, "not worth more than a bare mention" in Kass and Raftery. Lower: chance picks
    among equals. Higher: a plain law hides the right one."""
    close_evidence: float = 0.8
    """A rival with this share of the evidence is fitted to whole runs beside a sure law.
    Origin: chosen; one-step evidence is linear and takes no account of errors that last. Lower:
    fits that lose. Higher: of two correlated signals the wrong one is reported."""
    rival_evidence: float = 0.6
    """The same if the likeliest law is not surely worth anything over whole runs.
    Origin: chosen. Lower: fits that lose. Higher: nothing is learned where the second law was
    right."""
    imitated_share: float = 0.5
    """A law may stand for the effects found before it if it promises this share of their gain.
    Origin: chosen. Lower: a law is learned in vain beside the model as given. Higher: effects that
    only imitated the law stay."""
    replacing_error: float = 0.95
    """It stands for them if whole runs err by no more than this factor with it.
    Origin: chosen, a twentieth of the error. Lower: imitations stay. Higher: named effects give way
    to a curve that is no better."""
    hopeless_error: float = 2.0
    """A curve that errs by more than this factor where they stand is not made a law of.
    Origin: chosen; a closed form errs as its curve does, to a tenth. Lower: curves that unseen logs
    leave, which a form follows. Higher: minutes for a vessel."""
    noise_floor: float = 1.25
    """Whole runs err as one-step predictions do up to this factor: no law can do better.
    Origin: the one-step size is a t-distribution's, 0.87 of a Gaussian's standard deviation, so
    equality is 1.15; a tenth more is chosen. Lower: rivals of a perfect law are fitted. Higher: a
    law that leaves more than noise has no rival."""


@dataclass(frozen=True)
class ClosedForm:
    """Which closed form is fitted in the place of a learned curve, and becomes its name."""

    least_share_of_curve: float = 0.7
    """A form must promise this share of what the curve does.
    Origin: chosen; effects beside a law bend its curve. Lower: forms that miss a bend are fitted.
    Higher: the right form is not, where noise has bent the curve."""
    least_share_of_likeliest: float = 0.5
    """It must promise this share of what the likeliest form does.
    Origin: chosen. Lower: fits that lose. Higher: plain forms are not fitted beside a rich one."""
    most_fitted: int = 3
    """The number of forms that are fitted to whole runs, with the plain forms they come near to.
    Origin: chosen. Lower: the right form may be the second by one-step errors. Higher: time."""
    equal_error: float = 1.002
    """A form with which whole runs err by no more than this factor ends the search for richer ones.
    Origin: chosen. Lower: where fits end decides. Higher: a form is reported that misses a bend."""
    most_bic_apart: float = 10.0
    """Forms whose criteria differ by no more cannot be distinguished.
    Origin: more is very strong evidence in Kass and Raftery; 8 until one-step errors were asked as
    well. Lower: errors that last set apart forms that are as good. Higher: plain forms are reported
    in place of right ones."""


@dataclass(frozen=True)
class RivalModels:
    """Which other models of the same logs are searched for effects, and named."""

    within_reach: float = 1.5
    """A model is searched whose whole-run error as it is is no larger than this multiple of that of
    the diagnosed one as it was given.
    Origin: chosen. On a bench with a sagging supply a thruster errs 1.28 times as much as one
    behind a speed loop, and is right. Lower: that one is not searched. Higher: minutes for models
    that are far from the plant."""
    clear_share: float = 0.1
    """Another model is named if it surely removes something, and more than this share, of the
    squared whole-run error that the diagnosed one leaves with all that was found.
    Origin: chosen; a twentieth of the error. Lower: of two models as good the other is always
    named. Higher: a right model with one effect less is passed over."""


@dataclass(frozen=True)
class LineRule:
    """When a line in the spectrum of the errors is a force that is periodic in time."""

    level: float = 1e-4
    """A line is taken if noise shows one as high at any frequency no more often than this.
    Origin: measured; on 200 draws each of white and of autoregressive noise (correlation 0 to 0.98,
    400 to 4000 samples) no more than one fell below 1e-3, of random walks four. Lower: faint forces
    are missed. Higher: noise has a line."""
    least_samples: int = 100
    """A log with fewer measurements has no spectrum.
    Origin: the background takes tens of frequencies. Lower: it is a mean of few. Higher: short logs
    are not looked at."""
    least_cycles: float = 5.0
    """A line has so many cycles in the shortest log, or more.
    Origin: chosen; what is slower cannot be told from drift. Lower: drifts have lines. Higher: slow
    waves are missed."""
    most_of_nyquist: float = 0.9
    """A line is sought up to this share of half the rate of the samples.
    Origin: chosen. Lower: fast ripples are missed. Higher: the interpolation over lost samples
    makes lines."""
    signal_share: float = 0.3
    """It is no force of its own if a signal of the model has a line there of this share of its
    height.
    Origin: chosen; physics that lacks passes on the lines of what it depends on. Lower: a force
    near a line of the inputs is missed. Higher: what lacks under a periodic input is one."""


@dataclass(frozen=True)
class Settings:
    """All of them, by step."""

    screening: Screening = Screening()
    admission: Admission = Admission()
    whole_runs: WholeRuns = WholeRuns()
    pairs: Pairs = Pairs()
    equivalence: Equivalence = Equivalence()
    verdict: VerdictRule = VerdictRule()
    structure: Structure = Structure()
    outlier_logs: OutlierLogs = OutlierLogs()
    headroom: HeadroomRule = HeadroomRule()
    rival_models: RivalModels = RivalModels()
    line: LineRule = LineRule()
    unknown_term: UnknownTerm = UnknownTerm()
    closed_form: ClosedForm = ClosedForm()


SETTINGS = Settings()
