"""Options of the preprocessing: every word changes what it names and nothing else."""

import pytest

from lab.identify.slow_recording import chosen, mapping, recording
from rrrgen.base.errors import InputError, options_written
from rrrgen.lab.data.mapping import loads_mapping
from rrrgen.lab.data.preprocessing import Processing
from rrrgen.lab.identify.bandwidth import tune
from rrrgen.lab.studies.options import OptionError, PreprocessingOptions
from rrrgen.lab.studies.sources import chosen_processing


def test_a_butterworth_filter_without_a_cutoff_follows_the_same_rule():
    found = tune(Processing("butterworth"), [recording()])
    assert found.processing.cutoff == pytest.approx(5 * found.motion)
    named = tune(Processing("butterworth", cutoff=7.0, decimate=3), [recording()])
    assert (named.processing.cutoff, named.processing.decimate, named.by_rule) == (7.0, 3, ())
    assert "(as named)" in " ".join(named.sentences())


def test_every_word_on_the_command_line_changes_what_it_names_and_nothing_else():
    assert chosen() == chosen(method="kalman") == Processing("kalman")
    assert chosen(cutoff=20.0) == Processing("butterworth", cutoff=20.0)
    assert chosen(decimate=7) == Processing("kalman", decimate=7)
    file = "processing: {method: butterworth, cutoff: 12 Hz, decimate: 5, low_speed: 0.1}\n"
    of_file = Processing("butterworth", cutoff=12.0, decimate=5, low_speed=(0.1, 0.1))
    assert chosen(file) == of_file
    assert chosen(file, cutoff=20.0) == Processing("butterworth", cutoff=20.0, decimate=5, low_speed=(0.1, 0.1))
    assert chosen(file, method="kalman") == Processing("kalman", decimate=5, low_speed=(0.1, 0.1))
    assert chosen("processing: {cutoff: 12 Hz}\n") == Processing("butterworth", cutoff=12.0)
    assert chosen("processing: {position_resolution: 0.001}\n").method == "kalman"


@pytest.mark.parametrize("entry", ["processing: {method: ''}", "side: ''"])
def test_an_empty_word_is_none_of_the_allowed_ones(entry):
    with pytest.raises(InputError, match=r":8:\d+: error: .* is ''(.|\n)*allowed are "):
        loads_mapping(mapping(f"{entry}\n"))


@pytest.mark.parametrize("setting", ["cutoff: 0 Hz", "jerk: [1, 0]", "position_resolution: -0.1", "low_speed: -1"])
def test_a_setting_of_nothing_is_a_fault_of_the_file(setting):
    with pytest.raises(InputError, match=rf":8:\d+: error: processing.{setting.partition(':')[0]}"):
        loads_mapping(mapping(f"processing: {{{setting}}}\n"))


def test_words_that_would_be_ignored_are_refused():
    with pytest.raises(OptionError, match="add method butterworth"):
        chosen("processing: {method: kalman}\n", cutoff=20.0)
    with options_written(lambda name: f"--{name}"), pytest.raises(OptionError, match="belongs to --method butterworth"):
        chosen(method="kalman", cutoff=20.0)
    with pytest.raises(InputError) as caught:
        loads_mapping(mapping("processing: {method: kalman, cutoff: 20 Hz}\n"))
    fault = caught.value.faults[0]
    assert (fault.line, fault.column) == (8, 38)
    assert "cutoff has no meaning beside method kalman" in fault.message
    with pytest.raises(InputError, match="cutoff belongs to the method butterworth"):
        Processing("kalman", cutoff=3.0)
    two = [loads_mapping(mapping(f"processing: {{cutoff: {f} Hz}}\n"), f"{f}.yaml") for f in (10, 20)]
    with pytest.raises(InputError, match=r"10\.yaml and 20\.yaml disagree on cutoff .* or set cutoff$"):
        chosen_processing(two, PreprocessingOptions())
    assert chosen_processing(two, PreprocessingOptions(cutoff=15.0)).cutoff == 15.0
