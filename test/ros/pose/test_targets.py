# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The boards of a file: their topics, their frames, their numbers."""

from p4pfr_ros.files.yaml_fields import ConfigError
from p4pfr_ros.ros.parameters.pose_options import PoseNodeOptions
from p4pfr_ros.ros.pose.targets import MARKER, Targets
from p4pfr_ros.ros.runtime.rejections import Rejected
import pytest

ONE = '{type: chessboard, columns: 9, rows: 6, square_m: 0.025}'
OTHER = '{type: marker, id: 3, size_m: 0.15, dictionary: DICT_APRILTAG_36h11}'


@pytest.fixture
def targets(tmp_path):
    """Make targets of boards by name; without any there is no file."""

    def make(**boards):
        path = tmp_path / 'boards.yaml'
        lines = [f'  {name}: {board}' for name, board in boards.items()]
        path.write_text('\n'.join(['boards:', *lines]))
        return Targets(str(path) if boards else '')

    return make


@pytest.mark.parametrize(
    ('board_frame', 'expected'), [('', ['board']), ('left/board', ['left/board'])]
)
def test_without_a_file_there_is_one_board_without_a_name(targets, board_frame, expected):
    """Whatever board it is."""
    nameless = targets()
    assert nameless.prefixes == {'~'}
    assert [nameless.at(0).frame(board_frame)] == expected
    assert nameless.boards == {}


@pytest.mark.parametrize(('board_frame', 'expected'), [('', 'gate'), ('left/gate', 'left/gate')])
def test_one_board_has_the_plain_topics_and_its_name_as_its_frame(targets, board_frame, expected):
    """Unless it is given another frame; its name need not be a topic's."""
    alone = targets(gate=ONE)
    assert alone.prefixes == {'~'}
    assert alone.at(0).frame(board_frame) == expected
    assert targets(**{'my gate-1': ONE}).at(0).frame('') == 'my gate-1'


def test_each_of_several_boards_has_topics_and_a_frame_of_its_own(targets):
    """In the order of the file; a marker on the topic corners is none of them."""
    several = targets(gate=ONE, door=OTHER)
    assert several.prefixes == {'~', '~/gate', '~/door'}
    assert [several.at(i).prefix for i in range(2)] == ['~/gate', '~/door']
    assert [several.at(i).frame('') for i in range(2)] == ['gate', 'door']
    assert [several.at(i).frame('left') for i in range(2)] == ['left/gate', 'left/door']
    assert MARKER.frame('') == 'board'
    assert list(several.boards) == ['gate', 'door']


def test_only_a_board_that_is_alone_needs_no_number(targets):
    """Of several, which one it is would be a guess; the reason says what to do."""
    assert targets().at(None) is MARKER
    assert targets(gate=ONE).at(None).frame('') == 'gate'
    rejected = targets(gate=ONE, door=OTHER).at(None)
    assert rejected.cause == 'unknown_board'
    assert rejected.reason.endswith('its integer field board: 0 for gate, 1 for door')


def test_several_boards_cannot_all_be_parents_of_the_camera(targets):
    """In /tf a frame has one; it is said to whoever wants that."""
    wanted = PoseNodeOptions(publish_tf=True, invert_tf=True)
    remark = targets(gate=ONE, door=OTHER).remark_on_tf(wanted)
    assert remark.cause == 'tf_parents'
    assert 'invert_tf gives the frame of the camera 2 parents' in remark.reason
    assert targets(gate=ONE).remark_on_tf(wanted) is None
    several = targets(gate=ONE, door=OTHER)
    assert several.remark_on_tf(PoseNodeOptions(publish_tf=True)) is None
    assert several.remark_on_tf(PoseNodeOptions(invert_tf=True)) is None


@pytest.mark.parametrize('index', [-1, 2])
def test_a_number_beyond_the_file_is_rejected(targets, index):
    """The detector has another file, then."""
    rejected = targets(gate=ONE, door=OTHER).at(index)
    assert isinstance(rejected, Rejected)
    assert rejected.cause == 'unknown_board'


@pytest.mark.parametrize('name', ['my-gate', '1gate', '_gate', 'my gate', 'gäte'])
def test_of_several_boards_none_may_have_a_name_that_no_topic_can_have(targets, name):
    """It is said with file and key."""
    with pytest.raises(ConfigError, match=rf'boards.yaml: boards\.{name}: expected a letter, and'):
        targets(**{'gate': ONE, name: OTHER})
