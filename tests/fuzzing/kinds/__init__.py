"""The kinds of files that users hand to calib."""

from fuzzing.kinds.figure import FIGURE
from fuzzing.kinds.ledger import LEDGER
from fuzzing.kinds.output import OUTPUT
from fuzzing.kinds.record import RECORD
from fuzzing.kinds.study import STUDY
from fuzzing.kinds.template import TEMPLATE

KINDS = {kind.name: kind for kind in (STUDY, RECORD, LEDGER, TEMPLATE, OUTPUT, FIGURE)}
