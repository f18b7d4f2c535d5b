"""Answers about runs that were looked at while they ran: their e-values decide, and no test of the trials they have.

A test of a fixed number of trials is wrong more often than it says where the trials ended because of what they showed.
"""

from ...schemas.reports.against import Against, AgainstAnswer, Answer
from .compared_runs import NightRun
from .early_stops import Decision


def told_decision(asked: Against, found: Decision, *, is_over: bool) -> AgainstAnswer:
    """Converts a decision to the model that records have.

    Args:
        asked: the question.
        found: the decision.
        is_over: whether all pairs there will be have been looked at, so that what is open stays open.
    """
    answer: Answer = found.answer or "no difference shown"
    pairs = f"{found.pairs} of {_counted(found.planned, 'pair')}"
    worlds = f", {_counted(found.worlds, 'world')}" if found.worlds else ""
    if found.answer is not None:
        why = f"decided after {pairs}{worlds}"
    elif not found.planned:
        answer, why = "not comparable", "no job has the step, world and seed of one of that run"
    elif found.pairs and not found.judged:
        answer, why = "not comparable", f"none of {pairs} has a verdict by the same requirements in both runs"
    elif found.depends_on_lost:
        answer = "not comparable"
        why = f"after {pairs}{worlds} the answer depends on trials that broke or are missing; repair that and run again"
    elif found.is_hopeless and not is_over:
        why = f"after {pairs}{worlds} the others cannot decide it any more"
    else:
        why = f"not decided after {pairs}{worlds}"
    return AgainstAnswer(
        run_id=asked.run_id,
        alpha=asked.alpha,
        margin=asked.margin,
        answer=answer,
        why=why,
        pairs=found.pairs,
        planned=found.planned,
        e_values=dict(found.e_values),
    )


def answer_while_running(
    before: NightRun, after: NightRun, alpha: float, margin: float | None
) -> tuple[Answer, str] | None:
    """Returns the answer about two runs of which one was looked at while it ran, and why it is that.

    Args:
        before: the first run.
        after: the second run.
        alpha: error probability of all answers together; it may differ from the one with which the run was ordered.
        margin: fall of the pass rate that would matter, a share from 0 to 1; None: any.

    Returns:
        None: a test of all trials answers.
    """
    found = after.against
    if found is not None and found.run_id == before.run_id:
        return _by_evidence(after, found, alpha, margin)
    for run in (before, after):
        if run.against is not None and run.stopped_early:
            why = f"run {run.run_id} stopped early against run {run.against.run_id}, by what its trials showed"
            return "not comparable", f"{why}; compare it with that run, or run it again without --against"
    return None


def _by_evidence(after: NightRun, found: AgainstAnswer, alpha: float, margin: float | None) -> tuple[Answer, str]:
    if margin != found.margin:
        asked = f"--margin {100 * found.margin:.3g}" if found.margin is not None else "no --margin"
        return "not comparable", f"run {after.run_id} was carried out against {found.run_id} with {asked}: ask so, too"
    if alpha == found.alpha or found.answer == "not comparable":
        return found.answer, f"{found.why}{_evidence(found)}"
    enough: list[Answer] = [
        name for name in ("better", "not worse", "worse") if found.e_values.get(name, 0.0) >= 2 / alpha
    ]
    answer: Answer = "no difference shown"
    if enough:
        answer = max(enough, key=lambda name: found.e_values[name])
    pairs = f"{found.pairs} of {_counted(found.planned, 'pair')}"
    return answer, f"after {pairs}, at alpha {alpha:g}{_evidence(found)}"


def _evidence(found: AgainstAnswer) -> str:
    told = ", ".join(f"{name} {value:.3g}" for name, value in found.e_values.items())
    return f" (e-values: {told}; {2 / found.alpha:.3g} decide at alpha {found.alpha:g})" if told else ""


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}{'' if count == 1 else 's'}"
