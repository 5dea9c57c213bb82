#pragma once

#include <string>
#include <vector>

#include "apps/stages/input_record.hpp"
#include "apps/stored_run/stored_run.hpp"

namespace orbid::apps {

/// The measured inputs of an experiment of a stored run.
struct StoredInputs {
    std::vector<std::string> names;
    std::vector<std::string> units;  ///< empty: none
    LabelledInputs signals;          ///< one for all segments, or one each

    /// The signal of a segment; nullptr: there is none.
    [[nodiscard]] const models::InputSignal* of(const std::string& segment) const;
};

/// Read from the files that the job names; no names where the model has no inputs or a file is no longer there.
[[nodiscard]] StoredInputs stored_inputs(const StoredRun& run, const std::string& experiment);

/// The samples of the first experiment for which its inputs are known, delayed as the job says: nothing is
/// extrapolated.
/// @param inputs  one for each segment, as by_segment() gives them; empty: all samples are kept
/// @throws orbits::DataError where no sample of a segment is left.
[[nodiscard]] orbits::Series covered_by_inputs(const Job& job, orbits::Series series, const Inputs& inputs);

}  // namespace orbid::apps
