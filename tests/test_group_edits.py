"""Labels painted into ``groups.npz`` by hand are moved aside when parts are made again, made ones are not."""

import numpy as np

from phys4dgen.grouping.from_file import parts_from_file
from phys4dgen.run.artefacts import read_groups, write_groups
from phys4dgen.run.folder import RunFolder
from phys4dgen.run.group_edits import spare_edited_groups
from phys4dgen.types import Parts

PARTS = Parts(np.array([0, 1, 1, 0], np.int32), ("pot", "plant"), "test")


def test_edited_labels_are_kept_and_can_be_used_again(tmp_path):
    run = RunFolder(tmp_path)
    assert spare_edited_groups(run) is None
    write_groups(run, PARTS)
    assert spare_edited_groups(run) is None
    for number in (1, 2):
        with np.load(run.groups_npz, allow_pickle=False) as arrays:
            edited = dict(arrays)
        edited["labels"] = np.array([0, 0, 1, 0], np.int32)
        np.savez(run.groups_npz, allow_pickle=False, **edited)
        kept = spare_edited_groups(run)
        assert kept == tmp_path / f"groups_edited_{number}.npz"
        again = parts_from_file(kept, 4)
        np.testing.assert_array_equal(again.labels, [0, 0, 1, 0])
        assert again.names == PARTS.names
        write_groups(run, PARTS)
    np.testing.assert_array_equal(read_groups(run).labels, PARTS.labels)


def test_a_name_painted_over_counts_as_an_edit(tmp_path):
    run = RunFolder(tmp_path)
    write_groups(run, PARTS)
    np.savez(run.groups_npz, labels=PARTS.labels, names=np.array(["pot", "leaves"]))
    assert spare_edited_groups(run) is not None
