"""Which K is of these images, and what may a solver do with it? What states one makes a claim; a survey weighs them.

1.  *place*: every claim is brought to the size of the images by the reading that stands (:mod:`.placing`).
2.  *relate*: every two claims confirm or contradict each other, or do neither (:mod:`.relating`).
3.  *judge*: what a believed claim contradicts may not be used. A contradiction is disbelieved if two independent claims
    show it wrong, and nothing independent stands by it (:mod:`.survey`).

Commands select from the answer; nobody gets a K without its use.
"""

from __future__ import annotations

from calibrary.jobs.survey.claims import CATALOGUE, Claim, Who, of_entry, of_file, of_images
from calibrary.jobs.survey.placing import Placed
from calibrary.jobs.survey.relating import limit_between
from calibrary.jobs.survey.survey import Against, Survey, Weighed

__all__ = [
    "CATALOGUE",
    "Against",
    "Claim",
    "Placed",
    "Survey",
    "Weighed",
    "Who",
    "limit_between",
    "of_entry",
    "of_file",
    "of_images",
]
