"""Rows of the reproduction that are found again."""

import json

import pytest
from push_recovery.controllers.errors import InvalidValueError
from push_recovery.eval.reproduction.jobs import CaseJob, EpisodeJob, ScanJob, key, open_store, run_jobs
from push_recovery.eval.reproduction.pendulum import PushKind, Variant
from push_recovery.eval.reproduction.studies import KINDS, ProgramJob

STAGE_1, PUSH = Variant("stage-1", "stage-1"), PushKind(0.0, 0.1)
JOBS = (
    ProgramJob(next(iter(KINDS)), 90.0),
    EpisodeJob(STAGE_1, PUSH, 100.0),
    CaseJob(STAGE_1, PUSH, 100.0),
    ScanJob(STAGE_1, PUSH, (50.0,)),
)


def test_every_job_finds_the_fields_that_it_says(tmp_path):
    with open_store(tmp_path) as store:
        rows = run_jobs(JOBS, store, 1)
        assert run_jobs(JOBS, store, 1) == rows
    for job in JOBS:
        assert set(job.FIELDS) <= set(rows[key(job)]) - set(job.identity())


def test_a_row_that_lacks_something_is_named(tmp_path):
    job = JOBS[0]
    with open_store(tmp_path):
        pass
    (tmp_path / "outcomes.jsonl").write_text(json.dumps({"key": key(job), "label": "x"}) + "\n")
    with (
        open_store(tmp_path) as store,
        pytest.raises(InvalidValueError, match=rf"{key(job)}' lacks strength"),
    ):
        run_jobs([job], store, 1)
