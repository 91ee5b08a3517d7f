"""A frequency response as a function: from arrays without files, with the numbers of the command."""

import numpy as np
import pytest

import rrrgen
from lab.studies.commands import assert_same_files, printed_json
from samples.flexible_joint import flexible_joint, multisine, record


@pytest.fixture(scope="module")
def recordings():
    """Two realisations of one loop, as arrays."""
    rng = np.random.default_rng(8)
    found = [record(rng, multisine(rng, 8000), flexible_joint()) for _ in range(2)]
    return [{"t": 1e-3 * np.arange(len(one.q)), "n": one.n, "u": one.u, "q": one.q} for one in found]


def written(recording, folder):
    """The response file of a recording."""
    columns = np.column_stack([recording[key] for key in ("t", "n", "u", "q")])
    np.save(folder / "recording1.npy", columns)
    signals = "time: {column: 1}\nexcitation: {column: 2}\ninput: {column: 3}\noutput: {column: 4}\n"
    (folder / "response.yaml").write_text(f"schema: rrrgen-response/1\nfiles: recording1.npy\n{signals}")
    return folder / "response.yaml"


def test_arrays_give_the_numbers_and_files_of_the_command(recordings, tmp_path, capsys):
    result = rrrgen.frequency_response(recordings[0])
    file = written(recordings[0], tmp_path)
    assert printed_json(capsys, "response", "frf", file, "-o", tmp_path / "run") == (0, result.to_json())
    result.save(tmp_path / "saved")
    assert_same_files(tmp_path / "run", tmp_path / "saved", but=("run.json",))


def test_a_result_is_a_sequence_that_prints_and_draws_itself(recordings):
    result = rrrgen.frequency_response(recordings[0], method="instrumental")
    assert len(result) == 1
    assert list(result) == [result[0]]
    assert result.trusted
    truth = flexible_joint().response(result[0].frequency)
    # a band of 95 %, which a few of 400 lines leave
    inside = np.abs(result[0].P / truth - 1) < result[0].band95
    assert np.mean(inside) > 0.9
    assert "instrumental" in repr(result)
    assert "trusted" in result._repr_html_()
    assert result.plot("frf").axes


def test_a_list_of_arrays_is_averaged(recordings):
    (mean,) = rrrgen.frequency_response(recordings)
    assert mean.details["realisations"] == 2


def test_a_folder_does_not_mix_recordings(recordings, tmp_path):
    rrrgen.frequency_response(recordings[0], folder=tmp_path / "run")
    with pytest.raises(rrrgen.InputError, match="other inputs"):
        rrrgen.frequency_response(recordings[1], folder=tmp_path / "run")


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ({"y": 1}, {}, "has an array 'y'"),
        ({"q": None}, {"method": "indirekt"}, "did you mean 'indirect'"),
        ({"q": np.zeros(3)}, {}, "'q' has the shape"),
        ({}, {"method": "indirect"}, "needs the controller"),
    ],
)
def test_data_and_options_that_cannot_be_used_are_refused(recordings, change, options, message):
    with pytest.raises(rrrgen.InputError, match=message):
        rrrgen.frequency_response({**recordings[0], **change}, **options)


def test_realisations_are_excited_alike(recordings):
    other = {key: values for key, values in recordings[1].items() if key != "n"}
    with pytest.raises(rrrgen.InputError, match="some recordings have the excitation"):
        rrrgen.frequency_response([recordings[0], other])


def test_a_recording_that_is_given_twice_is_no_second_realisation(recordings, tmp_path):
    again = {key: values.copy() for key, values in recordings[0].items()}
    for study in (rrrgen.frequency_response, rrrgen.fit_response):
        with pytest.raises(rrrgen.InputError, match="recording1 and recording2 are one recording, given twice"):
            study([recordings[0], again])
    file = written(recordings[0], tmp_path)
    file.write_text(file.read_text().replace("recording1.npy", "[recording1.npy, ./recording1.npy]"))
    with pytest.raises(rrrgen.InputError, match=r"recording1\.npy is given twice: its noise would count"):
        rrrgen.frequency_response(file)
