"""A study's folder: the ledger of its trials, their record files, and a view for the dashboard."""

from calib.store.header import Header, StudyHeader
from calib.store.ledger import read
from calib.store.store import Store
from calib.store.trial import Trial

__all__ = ["Header", "Store", "StudyHeader", "Trial", "read"]
