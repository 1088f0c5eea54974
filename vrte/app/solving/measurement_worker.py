"""The process that shows a tab's scene beside a measurement while somebody changes the form."""

from vrte.app.solving.live_worker import answer_questions
from vrte.app.solving.measuring import Comparer


def main() -> None:
    """What was measured and what the scene shows there, again and again."""
    answer_questions(Comparer().answer)
