"""The views of many studies in one database."""

import json
import time
from collections.abc import Iterator, Sequence
from typing import Any

from optuna.distributions import distribution_to_json
from optuna.storages import BaseStorage, RDBStorage
from optuna.storages._rdb import models  # private: Optuna itself writes a trial by some 50 statements
from optuna.trial import FrozenTrial
from sqlalchemy import create_engine, func, inspect
from sqlalchemy.exc import DBAPIError
from sqlalchemy.orm import Session
from sqlalchemy.pool import NullPool

from calib.errors import CalibError
from calib.store.address import POSTGRESQL, address_without_password, failure_reason
from calib.store.mirrored import NUMBER, MirroredTrial

CONNECT_TIMEOUT = 10  # s, for a PostgreSQL server that does not answer
MAX_CREATIONS, CREATION_PAUSE = 5, 0.2  # attempts, s: to make the tables, which another process may be making too
CREATED_MEANWHILE = "already exists"  # what databases say then


def connected(url: str, skip_table_creation: bool = False) -> RDBStorage:
    """Optuna storage in a database; with `skip_table_creation` nothing is written.

    Raises
    ------
    CalibError : the database cannot be used; the message tells no password
    """
    try:
        return _created(url, skip_table_creation)
    except Exception as error:  # every driver has its own; all mean that the view cannot be used
        raise CalibError(f"{address_without_password(url)}: {failure_reason(error, url)}") from None


def _created(url: str, skip_table_creation: bool) -> RDBStorage:
    # a connection lasts as long as its transaction: a firewall would cut one that is idle, and a restart all
    options: dict[str, Any] = {"poolclass": NullPool}
    if url.startswith(POSTGRESQL) and "connect_timeout" not in url:
        options["connect_args"] = {"connect_timeout": CONNECT_TIMEOUT}
    literal = url.replace("{", "{{").replace("}", "}}")  # Optuna fills in braces
    if skip_table_creation and not inspect(create_engine(url, **options)).has_table(models.StudyModel.__tablename__):
        raise CalibError("no view there yet; `calib run` makes it with the first trial")
    for attempt in range(1, MAX_CREATIONS + 1):
        try:
            return RDBStorage(literal, options, skip_table_creation=skip_table_creation)
        except DBAPIError as error:
            if CREATED_MEANWHILE not in str(error) or attempt == MAX_CREATIONS:
                raise
            time.sleep(CREATION_PAUSE)
    raise AssertionError("the last attempt returns or raises")


class DatabasePlace:
    """A database whose address Optuna takes, such as one of PostgreSQL; raises what its driver raises."""

    shared = True  # with the views of other ledgers

    def __init__(self, url: str):
        self._storage = _created(url, skip_table_creation=False)
        self.storage: BaseStorage = self._storage

    def whole(self) -> BaseStorage:
        """Storage that knows the trials too."""
        return self.storage

    def mirrored(self, study: int) -> Iterator[MirroredTrial]:
        """Yield the trials of an Optuna study."""
        trial, value, attribute = models.TrialModel, models.TrialValueModel, models.TrialUserAttributeModel
        with Session(self._storage.engine) as session:
            rows = (
                session.query(trial.state, value.value, attribute.value_json)
                .outerjoin(value, value.trial_id == trial.trial_id)
                .outerjoin(attribute, (attribute.trial_id == trial.trial_id) & (attribute.key == NUMBER))
                .filter(trial.study_id == study)
            )
            for state, cost, number in rows:
                yield MirroredTrial(None if number is None else json.loads(number), cost, state)

    def add(self, study: int, trials: Sequence[FrozenTrial]) -> None:
        """Add finished trials to an Optuna study: either all, or none where this fails."""
        with Session(self._storage.engine) as session, session.begin():
            models.StudyModel.find_or_raise_by_id(study, session, for_update=True)  # one writer at a time
            first = session.query(func.count(models.TrialModel.trial_id)).filter_by(study_id=study).scalar()
            for number, trial in enumerate(trials, start=first):
                session.add_all(_rows(trial, study, number))

    def close(self) -> None:
        """Close the connection."""
        self._storage.remove_session()


def _rows(trial: FrozenTrial, study: int, number: int) -> list[Any]:
    """Rows of all tables for a trial, which has this number among those of its study."""
    own = models.TrialModel(
        study_id=study,
        number=number,
        state=trial.state,
        datetime_start=trial.datetime_start,
        datetime_complete=trial.datetime_complete,
    )
    rows: list[Any] = [own]
    if trial.value is not None:
        value, kind = models.TrialValueModel.value_to_stored_repr(trial.value)
        rows.append(models.TrialValueModel(trial=own, objective=0, value=value, value_type=kind))
    for name, quantity in trial.params.items():
        distribution = trial.distributions[name]
        internal, described = distribution.to_internal_repr(quantity), distribution_to_json(distribution)
        rows.append(
            models.TrialParamModel(trial=own, param_name=name, param_value=internal, distribution_json=described)
        )
    for model, attributes in (
        (models.TrialUserAttributeModel, trial.user_attrs),
        (models.TrialSystemAttributeModel, trial.system_attrs),
    ):
        rows += [model(trial=own, key=key, value_json=json.dumps(entry)) for key, entry in attributes.items()]
    return rows
