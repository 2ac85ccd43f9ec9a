# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The boards of a file: their topics, frames and indices."""

from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
from p4pfr_ros.ros.pose.inputs import Inputs, MARKER
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest

ONE = '{type: chessboard, columns: 9, rows: 6, square_m: 0.025}'
OTHER = '{type: marker, id: 3, size_m: 0.15, dictionary: DICT_APRILTAG_36h11}'


@pytest.fixture
def inputs(tmp_path):
    """Make inputs with boards by name; without any there is no file."""

    def make(**boards):
        path = tmp_path / 'boards.yaml'
        lines = [f'  {name}: {board}' for name, board in boards.items()]
        path.write_text('\n'.join(['boards:', *lines]))
        return Inputs(str(path) if boards else '')

    return make


@pytest.mark.parametrize(
    ('board_frame', 'expected'), [('', ['board']), ('left/board', ['left/board'])]
)
def test_without_a_file_there_is_one_board_without_a_name(inputs, board_frame, expected):
    """Any board may be sent."""
    nameless = inputs()
    assert nameless.prefixes == {'~'}
    assert [nameless.target(0).frame(board_frame)] == expected
    assert nameless.boards == {}


@pytest.mark.parametrize(('board_frame', 'expected'), [('', 'gate'), ('left/gate', 'left/gate')])
def test_a_single_board_has_topics_without_its_name(inputs, board_frame, expected):
    """Its name is its frame by default, and need not be valid in a topic name."""
    alone = inputs(gate=ONE)
    assert alone.prefixes == {'~'}
    assert alone.target(0).frame(board_frame) == expected
    assert inputs(**{'my gate-1': ONE}).target(0).frame('') == 'my gate-1'


def test_each_of_several_boards_has_its_own_topics_and_frame(inputs):
    """In the order of the file; the marker on the topic corners is not one of them."""
    several = inputs(gate=ONE, door=OTHER)
    assert several.prefixes == {'~', '~/gate', '~/door'}
    assert [several.target(i).prefix for i in range(2)] == ['~/gate', '~/door']
    assert [several.target(i).frame('') for i in range(2)] == ['gate', 'door']
    assert [several.target(i).frame('left') for i in range(2)] == ['left/gate', 'left/door']
    assert MARKER.frame('') == 'board'
    assert list(several.boards) == ['gate', 'door']


def test_only_a_single_board_needs_no_index(inputs):
    """With several boards the reason lists the indices."""
    assert inputs().target(None) is MARKER
    assert inputs(gate=ONE).target(None).frame('') == 'gate'
    rejected = inputs(gate=ONE, door=OTHER).target(None)
    assert rejected.cause == 'unknown_board'
    assert rejected.reason.endswith('the integer field board: 0 for gate, 1 for door')


def test_several_boards_cannot_all_be_parents_of_the_camera(inputs):
    """A frame in /tf has one parent; a notice says so."""
    wanted = PoseNodeOptions(publish_tf=True, invert_tf=True)
    notice = inputs(gate=ONE, door=OTHER).tf_conflict(wanted)
    assert notice.cause == 'tf_parents'
    assert 'invert_tf gives the camera frame 2 parents' in notice.reason
    assert inputs(gate=ONE).tf_conflict(wanted) is None
    several = inputs(gate=ONE, door=OTHER)
    assert several.tf_conflict(PoseNodeOptions(publish_tf=True)) is None
    assert several.tf_conflict(PoseNodeOptions(invert_tf=True)) is None


@pytest.mark.parametrize('index', [-1, 2])
def test_an_index_beyond_the_file_is_rejected(inputs, index):
    """The detector uses another file."""
    rejected = inputs(gate=ONE, door=OTHER).target(index)
    assert isinstance(rejected, Rejected)
    assert rejected.cause == 'unknown_board'


@pytest.mark.parametrize('name', ['my-gate', '1gate', '_gate', 'my gate', 'gäte'])
def test_names_of_several_boards_must_be_valid_in_topic_names(inputs, name):
    """The error names file and key."""
    with pytest.raises(ConfigError, match=rf'boards.yaml: boards\.{name}: expected a letter, and'):
        inputs(**{'gate': ONE, name: OTHER})
