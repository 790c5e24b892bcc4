"""Ask the debugger's questions from Python: why did queries fail, and why did an edge leave the map?

`python examples/09_ask_why_from_python.py` prints the answers of the page's Why tab about `recordings/demo-fault.rrd`.
`ltvn why` gives the same answers in a terminal.
"""

import sys
from pathlib import Path

import ltvn_core as ltvn
from ltvn_core.graph.deltas import EdgePruned
from ltvn_viz.debugger.file_questions import FileAsk, FileCase, ask_file

DEMO = Path(__file__).parents[1] / "recordings" / "demo-fault.rrd"


def main(path: Path) -> None:
    """Print why queries failed, what the page says of the last failure, and how the last pruned edge was lost."""
    case = FileCase(path)
    failures = ltvn.analysis.failed_queries(case.timeline)
    for failure in failures:
        print(f"query {failure.query.id} failed ({failure.ending}, {failure.failure_mode}): {failure.text}")

    for failure in failures[-1:]:
        print(f"\n--- Query {failure.query.id}, as the page answers")
        print(ltvn.analysis.answer_text(ask_file(case, FileAsk(query=failure.query.id)).answer))

    pruned = [change.delta for change in case.timeline.changes if isinstance(change.delta, EdgePruned)]
    for edge in pruned[-1:]:
        print(f"\n--- Edge {edge.source} -> {edge.target}, as the page answers")
        print(ltvn.analysis.answer_text(ask_file(case, FileAsk(edge=(edge.source, edge.target))).answer))

        print("\n--- Its reasons alone, each with the step to look at")
        for reason in ltvn.analysis.explain_edge(case.timeline, edge.source, edge.target):
            print(f"at step {reason.instant.step if reason.instant else '?'}: {reason.text}")


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else DEMO)
