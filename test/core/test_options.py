# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Options: the range and the description of every field, and their documentation."""

import dataclasses
import inspect
import re

import numpy as np
from p4pfr_ros import CalibrationOptions, EstimateOptions
from p4pfr_ros.core.options import check_options, option, option_of
import pytest

FIELDS = [
    (kind, field.name)
    for kind in (EstimateOptions, CalibrationOptions)
    for field in dataclasses.fields(kind)
]
over_kinds = pytest.mark.parametrize('kind', [EstimateOptions, CalibrationOptions])
SWITCHES = [(kind, name) for kind, name in FIELDS if isinstance(getattr(kind(), name), bool)]
over_fields = pytest.mark.parametrize(('kind', 'name'), FIELDS)
over_numbers = pytest.mark.parametrize(
    ('kind', 'name'), [field for field in FIELDS if field not in SWITCHES]
)
over_switches = pytest.mark.parametrize(('kind', 'name'), SWITCHES)
# The fields for which None means that no value is given.
OPTIONAL = {'sigma_px', 'prior_focal_px', 'prior_focal_sigma_px', 'prior_k_sigma'}


@dataclasses.dataclass(frozen=True)
class Sample:
    """Two options."""

    share: float = option(0.5, 'A share.', low=0.25, high=0.75)
    size: float | None = option(None, 'A size.', low=1.0, high=2.0)


@pytest.mark.parametrize('share', [0.25, 0.5, 0.75])
@pytest.mark.parametrize('size', [None, 1.0, 2.0])
def test_values_from_low_to_high_and_none_are_accepted(share, size):
    check_options(Sample(share, size))


@pytest.mark.parametrize('value', [np.nextafter(0.25, 0.0), np.nextafter(0.75, 1.0), np.inf, -1.0])
def test_values_beyond_the_range_are_rejected(value):
    with pytest.raises(ValueError, match=r'^share must be from 0\.25 to 0\.75, got '):
        check_options(Sample(share=value))


def test_nan_is_out_of_every_range():
    with pytest.raises(ValueError, match=r'^size must be from 1 to 2, got nan$'):
        check_options(Sample(size=np.nan))


def test_the_error_names_the_first_field_out_of_its_range():
    with pytest.raises(ValueError, match=r'^share must be from 0'):
        check_options(Sample(0.0, 0.0))


@over_switches
@pytest.mark.parametrize('value', [0, 1, 0.0, np.nan, None, 'True', np.zeros(2)])
def test_every_switch_is_true_or_false(kind, name, value):
    assert getattr(kind(**{name: True}), name) is True
    assert getattr(kind(**{name: False}), name) is False
    with pytest.raises(ValueError, match=f'^{name} must be True or False, got '):
        kind(**{name: value})


@over_numbers
def test_every_number_rejects_nan_and_values_beyond_its_range(kind, name):
    limits = option_of(kind, name)
    assert limits.low < limits.high
    for value in (np.nan, np.nextafter(limits.low, -np.inf), np.nextafter(limits.high, np.inf)):
        with pytest.raises(ValueError, match=f'^{name} must be from '):
            kind(**{name: value})


@over_numbers
def test_every_default_is_in_its_range(kind, name):
    limits, default = option_of(kind, name), getattr(kind(), name)
    assert (default is None) == (name in OPTIONAL)
    assert default is None or limits.low <= default <= limits.high


@over_fields
def test_every_field_has_a_description_of_one_or_more_sentences(kind, name):
    description = option_of(kind, name).description
    assert re.fullmatch(r'[A-Z].{10,}\.', description)
    # The parameters of the nodes and the command line show it: plain ASCII.
    assert description.isascii()


@over_kinds
def test_the_docstring_lists_the_fields_in_their_order(kind):
    section = inspect.getdoc(kind).split('Parameters\n----------\n')[1].split('\nRaises\n')[0]
    heads = [line for line in section.splitlines() if line and not line.startswith(' ')]
    listed = [name for head in heads for name in head.split(', ')]
    assert listed == [field.name for field in dataclasses.fields(kind)]
