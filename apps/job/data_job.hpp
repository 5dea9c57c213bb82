#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <filesystem>
#include <limits>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "apps/job/column_job.hpp"
#include "apps/job/model_job.hpp"
#include "estimator/interface/estimate_options.hpp"
#include "estimator/interface/prior.hpp"
#include "identification/problem/experiment.hpp"
#include "models/definition/input_signal.hpp"
#include "models/definition/sensor.hpp"
#include "orbits/records/record_part.hpp"
#include "orbits/records/series.hpp"

namespace orbid::apps {

/// As jobs write them, in the order of orbits::Series::Sampling.
inline const std::vector<std::string> sampling_names{"section", "samples"};
/// In the order of models::InputSignal::Interpolation.
inline const std::vector<std::string> interpolation_names{"linear", "cubic", "held", "band_limited"};
/// In the order of models::Sensor::Rounding.
inline const std::vector<std::string> rounding_names{"none", "nearest"};

struct SimulationJob {
    /// Default of `transient` for random starts of a section series; 0 for given starts and for samples. A contraction
    /// of only 10 % per period leaves 1e-14 of the distance to the attractor after 300 periods.
    static constexpr std::size_t transient_of_random_sections = 300;

    orbits::Series::Sampling sampling = orbits::Series::Sampling::section;
    std::size_t sections = 0;              ///< section: points of all trajectories together, >= trajectories
    double step = 0.0;                     ///< samples: [s], > 0
    std::size_t count = 0;                 ///< samples: per trajectory, >= 2, the first at the end of the transient
    std::size_t trajectories = 1;          ///< >= 1; one segment each
    std::size_t transient = 0;             ///< section: periods, samples: steps; discarded before the first point
    std::vector<Eigen::VectorXd> initial;  ///< one state per trajectory; empty = random
    bool restart = true;                   ///< a captured or resting trajectory is restarted; false = only reported
    Eigen::VectorXd noise;                 ///< shape (n): sd of a reading in the coordinate's unit, >= 0
    Eigen::VectorXd noise_correlation;     ///< shape (n): of the errors of successive readings, in (-1, 1)
};

/// A recorded series: a text table (.csv, .tsv, .txt), or a file written by orbid (.h5, .hdf5), which describes its
/// columns itself.
struct FileJob {
    std::vector<std::filesystem::path> paths;  ///< absolute; one, or all that match `pattern`, in the order of bytes
    std::string pattern;                       ///< absolute, * and ? stand for letters; empty: one file
    orbits::Series::Sampling sampling = orbits::Series::Sampling::section;
    bool table = true;           ///< text with columns; false: HDF5, `columns` and the two names are empty
    std::string segment_column;  ///< empty: the whole file is one segment
    std::string time_column;     ///< samples need one
    std::string time_unit = "s";
    std::vector<ColumnJob> columns;  ///< in the order of the coordinates
    double step = 0.0;               ///< [s] interval of samples in a table without a column of times; else 0
    bool evenly_spaced = true;       ///< samples in equal steps; false: each at its own time
    orbits::RecordPart part;         ///< what is read; `every` belongs to samples
    bool nan_is_missing = false;     ///< "nan" in a cell is a missing sample too, not only an empty cell
    /// Read piece by piece, never as a whole: MB of memory for what is held of it at a time; 0: it is read as a whole.
    double stream_memory = 0.0;
    std::string sha256;  ///< expected, lower-case hex; of several files: of the list of theirs; empty: not given

    /// [B], of those that exist.
    [[nodiscard]] double bytes() const;
    /// Name of a segment of one of the files: its label; with a pattern the path from the folder in which the pattern
    /// has its first * or ?, without extension, and "/label" where a column names the segments.
    [[nodiscard]] std::string segment_name(const std::filesystem::path& path, const std::string& label) const;
    /// A file, or the pattern of several, as messages name it.
    [[nodiscard]] std::string shown() const { return pattern.empty() ? paths.front().string() : pattern; }
};

/// Measured inputs of the model, from the experiment's own table or a separate one.
struct InputJob {
    std::optional<std::filesystem::path> file;  ///< absolute; empty: the table of the data
    std::string sha256;                         ///< of `file`, expected; empty: not given
    std::string time_column = "t";              ///< of `file`
    std::string time_unit = "s";
    std::vector<ColumnJob> columns;  ///< one per input of the model, in its order; `coordinate` is the input's index
    models::InputSignal::Interpolation interpolation = models::InputSignal::Interpolation::linear;
    double delay = 0.0;                           ///< [s] between an input and its effect: the model reads u(t - delay)
    std::optional<Eigen::Index> delay_parameter;  ///< the model's, in place of `delay`
};

using InitialValueJob = identification::InitialValue;
using identification::initial_parameter_name;

/// One experiment.
struct DataJob {
    std::string name;
    std::optional<SimulationJob> simulation;  ///< exactly one of simulation and file
    std::optional<FileJob> file;
    std::optional<InputJob> inputs;  ///< of a model that has some
    models::Sensor sensor;
    std::vector<Eigen::Index> observe;            ///< coordinates used as data, ascending
    std::vector<ParameterValue> parameters;       ///< values for this experiment only
    std::vector<Eigen::Index> free;               ///< parameters estimated for this experiment only (name@experiment)
    std::optional<std::vector<std::string>> fit;  ///< labels of segments; empty = all not in `predict`
    std::vector<std::string> predict;             ///< labels of segments predicted, not fitted
    std::vector<InitialValueJob> initial_state;   ///< one per coordinate

    [[nodiscard]] orbits::Series::Sampling sampling() const {
        return simulation ? simulation->sampling : file->sampling;
    }
    /// Its record is read piece by piece.
    [[nodiscard]] bool streamed() const { return file && file->stream_memory > 0.0; }
    [[nodiscard]] bool observes(Eigen::Index coordinate) const {
        return std::find(observe.begin(), observe.end(), coordinate) != observe.end();
    }
    /// Whether a parameter is estimated for this experiment only.
    [[nodiscard]] bool has_own(Eigen::Index parameter) const {
        return std::find(free.begin(), free.end(), parameter) != free.end();
    }
    /// All parameters, with its own values among these.
    [[nodiscard]] Eigen::VectorXd with_own(Eigen::VectorXd values) const {
        for (const ParameterValue& own : parameters)
            values[own.parameter] = own.value;
        return values;
    }
};

}  // namespace orbid::apps
