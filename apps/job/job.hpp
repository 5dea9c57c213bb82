#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

#include <Eigen/Core>

#include "estimator/estimate/estimate.hpp"
#include "estimator/interface/prior.hpp"
#include "estimator/interface/residual.hpp"
#include "models/definition/input_signal.hpp"
#include "models/definition/sensor.hpp"
#include "models/equations/equations.hpp"
#include "models/formulas/expression.hpp"
#include "models/system/system.hpp"
#include "orbits/cycles/cycle_search.hpp"
#include "orbits/invariants/cycle_expansion.hpp"
#include "orbits/records/series.hpp"
#include "periodic/branches/continuation.hpp"
#include "periodic/search/orbit_search.hpp"
#include "periodic/solution/solve_orbit.hpp"
#include "periodic/waveforms/waveform_record.hpp"

namespace orbid::apps {

/// A job file as plain data: every name resolved to an index, every default filled in, every path absolute.
/// A Job from job_reader has passed all checks that need no data.

/// Whether equations of a job are compiled before they are used.
enum class CompileChoice { automatic, always, never };

struct ModelJob {
    std::string name;
    std::string variant;                                 ///< as the system names it; empty when the model has none
    std::optional<std::size_t> size;                     ///< number of cells, where the model allows a choice
    std::shared_ptr<const models::Equations> equations;  ///< a model written in the job; nothing: one of the registry
    CompileChoice compile = CompileChoice::automatic;    ///< of such a model
    bool compiled = false;                               ///< it is evaluated by compiled code
    std::shared_ptr<const models::System> system;
    Eigen::VectorXd values;  ///< shape (q): all parameters, for simulated data and fixed values
};

/// Values of single parameters, for one experiment.
struct ParameterValue {
    Eigen::Index parameter;  ///< index into System::parameters()
    double value;
};

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

/// One coordinate read from a column of a table:  model value = sign * (column * unit - offset).
struct ColumnJob {
    Eigen::Index coordinate = 0;  ///< index into System::coordinates()
    std::string column;           ///< header in the file
    std::string unit;             ///< of the column; one that orbits::unit_factor knows for the coordinate
    int sign = 1;                 ///< +1 or -1
    double offset = 0.0;          ///< in the coordinate's unit
};

/// A recorded series: a text table (.csv, .tsv, .txt), or a file written by orbid (.h5, .hdf5), which describes its
/// columns itself.
struct FileJob {
    std::filesystem::path path;  ///< absolute
    orbits::Series::Sampling sampling = orbits::Series::Sampling::section;
    bool table = true;           ///< text with columns; false: HDF5, `columns` and the two names are empty
    std::string segment_column;  ///< empty: the whole file is one segment
    std::string time_column;     ///< samples need one
    std::string time_unit = "s";
    std::vector<ColumnJob> columns;  ///< in the order of the coordinates
    bool nan_is_missing = false;     ///< "nan" in a cell is a missing sample too, not only an empty cell
    std::string sha256;              ///< expected, lower-case hex; empty: not given
};

/// Measured inputs of the model, from the experiment's own table or a separate one.
struct InputJob {
    std::optional<std::filesystem::path> file;  ///< absolute; empty: the table of the data
    std::string sha256;                         ///< of `file`, expected; empty: not given
    std::string time_column = "t";              ///< of `file`
    std::string time_unit = "s";
    std::vector<ColumnJob> columns;  ///< one per input of the model, in its order; `coordinate` is the input's index
    models::InputSignal::Interpolation interpolation = models::InputSignal::Interpolation::linear;
};

/// Where one coordinate of a segment's initial state comes from.
struct InitialValueJob {
    bool estimate = true;
    std::optional<double> value;  ///< fixed value, or start when estimated; empty: start from the data
    estimator::Prior prior = estimator::FlatPrior{};
    estimator::Scale scale = estimator::Scale::linear;
    double lower = -std::numeric_limits<double>::infinity();
    double upper = std::numeric_limits<double>::infinity();

    /// It has settings that a latent state cannot have. It becomes a parameter of the estimate, one per segment, named
    /// by initial_parameter_name.
    [[nodiscard]] bool is_parameter() const {
        const bool plain = std::holds_alternative<estimator::FlatPrior>(prior) ||
                           std::holds_alternative<estimator::NormalPrior>(prior);
        return estimate && !(plain && scale == estimator::Scale::linear && std::isinf(lower) && std::isinf(upper));
    }
};

/// "u_0@run1": a coordinate's value at the first sample of an experiment. With several fitted segments ".LABEL"
/// follows.
[[nodiscard]] inline std::string initial_parameter_name(const std::string& coordinate, const std::string& experiment) {
    return coordinate + "_0@" + experiment;
}

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
};

/// Orders of local maps by name; the index is CycleSearchOptions::order.
inline const std::vector<std::string> local_map_names{"auto",    "linear",  "quadratic", "cubic",
                                                      "quartic", "quintic", "sextic"};

/// Cycles come from a search in the section series, or from a file.
struct OrbitsJob {
    std::optional<std::filesystem::path> file;  ///< absolute path of a cycles.json
    std::string sha256;                         ///< of that file, expected; empty: not given
    orbits::CycleSearchOptions search;          ///< symmetry_signs filled from the model
    Eigen::VectorXd reading_sd;  ///< of a reading, one per coordinate of the model; empty: estimated from the series
    bool invariants = false;     ///< exponents, dimensions and entropies from the series and, if complete, the cycles
    orbits::CycleExpansionOptions expansion = {};  ///< complete_to 0: not stated, no expansion
    std::size_t data = 0;                          ///< index into Job::data of the searched series; unused with `file`
};

struct OrbitStart {
    int period = 1;
    std::vector<int> rotation;  ///< one per angle coordinate; empty: from the points
    Eigen::MatrixXd points;     ///< shape (n, p)
    double time = 0.0;          ///< T [s], > 0: autonomous models without a section, which have one point; else 0
};

/// Methods of the "periodic" block, in the order of periodic::OrbitMethod.
inline const std::vector<std::string> periodic_method_names{"multiple_shooting", "finite_difference", "collocation"};

/// A branch of orbits over one parameter, from the orbit that the job names.
struct ContinuationJob {
    std::size_t orbit = 0;  ///< of the list in orbits.json where it starts
    periodic::ContinuationOptions options;
    std::optional<Eigen::Index> plotted;  ///< coordinate shown in branch.svg; empty: the time T
};

struct PeriodicJob {
    periodic::OrbitMethod method;
    std::vector<OrbitStart> orbits;
    std::optional<periodic::OrbitSearchOptions> search;  ///< phase and section are the job's
    std::optional<ContinuationJob> continuation;
    std::vector<Eigen::Index> free;  ///< parameters for sensitivities, different
    bool stability = false;          ///< directions, and derivatives of the multipliers to the free parameters
};

/// A section of an autonomous flow: coordinate = value, crossed in one direction.
struct SectionPlaneJob {
    Eigen::Index coordinate = 0;
    double value = 0.0;
    int direction = 1;  ///< +1 while the coordinate rises, -1 while it falls
};

struct FreeParameterJob {
    Eigen::Index parameter;          ///< index into System::parameters()
    estimator::FreeParameter value;  ///< start, scale, bounds, prior, tie; name and unit of the model
};

struct DerivedJob {
    std::string name;
    models::Expression expression;  ///< in System::parameters(), in that order
};

/// Errors of one coordinate. ErrorScale::value is 0 while estimated without a start: "start from the residuals".
struct ErrorJob {
    Eigen::Index coordinate = 0;
    estimator::ErrorScale scale;  ///< with `sd_column` a factor on the sds there
    estimator::ErrorDistribution distribution = estimator::NormalErrors{};
    double floor = 0.0;     ///< least value of an estimated scale
    std::string sd_column;  ///< header in the table of the data; empty: one sd for all readings
};

/// Several coordinates with one full covariance, estimated.
struct CovarianceJob {
    std::vector<Eigen::Index> coordinates;  ///< two or more, normal
    double dof = 0.0;                       ///< of its inverse-Wishart prior; 0: none
    Eigen::MatrixXd psi;                    ///< shape (m, m), with a prior
};

struct CyclesResidualJob {
    std::vector<int> periods;
    bool covariance = true;        ///< weights: the analysis' covariance times a factor; false: equal, a sd
    bool positions = true;         ///< the points are data
    bool multipliers = false;      ///< ln|multiplier| is data; at least one of the two
    std::vector<ErrorJob> errors;  ///< one per coordinate of the model, in their order
    std::vector<CovarianceJob> covariances;
    estimator::ErrorScale multiplier_error{true, 0.0, estimator::FlatPrior{}};  ///< as ErrorJob::scale
};

/// How closely the end of an interval of a series must agree with the beginning of the next.
struct MatchingJob {
    enum class Kind {
        automatic,  ///< exact
        exact,      ///< to far below the errors of the readings
        given,      ///< normal errors of a known sd
        estimated   ///< normal errors, their sd estimated
    };
    Kind kind = Kind::automatic;
    double sd = 0.0;  ///< given: share of each coordinate's range, > 0
};

/// A recorded series, by single or multiple shooting.
struct SeriesResidualJob {
    static constexpr std::size_t automatic_interval = 0;  ///< chosen by how errors grow
    /// Sampling intervals (sections) from node to node. Nothing: one free initial state per segment (single shooting).
    std::optional<std::size_t> interval;
    MatchingJob matching;           ///< ignored without an interval
    std::vector<std::size_t> data;  ///< indices into Job::data
    std::vector<ErrorJob> errors;   ///< one per coordinate observed in any of them, ascending
    std::vector<CovarianceJob> covariances;
};

/// Measured periodic steady states, one per fitted segment.
struct WaveformResidualJob {
    struct Experiment {
        int period = 1;     ///< in periods of the forcing
        double time = 0.0;  ///< autonomous: a guess of T [s]
        periodic::WaveformUnknown phase{true, 0.0};
        std::vector<periodic::WaveformUnknown> offsets;  ///< one per entry of `errors`
        Eigen::MatrixXd start;                           ///< shape (n, period): states at phase 0; empty: found
    };
    std::vector<std::size_t> data;        ///< indices into Job::data
    std::vector<Experiment> experiments;  ///< one per entry of `data`
    std::vector<ErrorJob> errors;         ///< one per coordinate observed in any of them, ascending
    std::vector<CovarianceJob> covariances;
};

enum class ResidualType { cycles, series, waveform };

/// As jobs write them, in the order of ResidualType.
inline const std::vector<std::string> residual_type_names{"cycles", "series", "waveform"};

/// One step of an estimate; it starts from the best earlier one.
struct StageJob {
    enum class Kind {
        prediction,  ///< parameters only, by predictions over one interval from measured states
        residuals,   ///< the residuals named, together
        harvest      ///< adds cycles found with the present model, then as the stage of the cycles
    };
    Kind kind = Kind::residuals;
    std::vector<ResidualType> residuals;  ///< in their order; empty for `prediction`

    [[nodiscard]] bool uses(ResidualType type) const {
        return std::find(residuals.begin(), residuals.end(), type) != residuals.end();
    }
    /// "prediction", "harvest", "series", "cycles + series".
    [[nodiscard]] std::string name() const;
};

/// Other models that the estimate is compared with.
struct CriticismJob {
    std::vector<std::string> variants;  ///< of the model, other than the job's
    std::vector<Eigen::Index> without;  ///< parameters of the estimate, set to 0 one at a time
    double held_out = 0.0;              ///< share of the data left out in turn and predicted; 0: none

    [[nodiscard]] bool any() const { return !variants.empty() || !without.empty() || held_out > 0.0; }
};

/// Estimates from several starts; 1 = only the job's.
struct MultiStartJob {
    std::size_t starts = 1;
    std::uint64_t seed = 1;  ///< the job's, unless another is given
};

/// Draws from the posterior density; 0 draws: none.
struct SampleJob {
    std::size_t draws = 0;   ///< per chain, after the warm-up
    std::size_t chains = 4;  ///< >= 2: their agreement is tested
    std::size_t warm_up = 500;
};

/// A selection of estimated parameters.
struct ParameterChoice {
    bool all = false;
    std::vector<std::string> names;  ///< of the estimate's parameters, unless all

    [[nodiscard]] bool any() const { return all || !names.empty(); }
    /// Also for every segment of an initial value named without one.
    [[nodiscard]] bool contains(const std::string& name) const;
};

struct EstimateJob {
    std::vector<FreeParameterJob> parameters;
    std::vector<estimator::JointNormalPrior> joint_priors;
    std::vector<DerivedJob> derived;
    std::optional<CyclesResidualJob> cycles;
    std::optional<SeriesResidualJob> series;
    std::optional<WaveformResidualJob> waveform;
    bool automatic = false;          ///< "strategy": "auto"
    std::vector<StageJob> strategy;  ///< in this order; each residual is used in at least one of them
    bool scan = false;               ///< the prediction starts with a coarse scan of the parameters over their bounds
    CriticismJob criticism;
    estimator::Variance variance = estimator::Variance::restricted;
    MultiStartJob multi_start;
    SampleJob sample;
    ParameterChoice profile;
    ParameterChoice marginals;
};

struct ReferenceJob {
    std::string name;  ///< of a parameter of the model or a derived quantity
    double value;
};

enum class SeriesOutput { h5, csv, none };

/// What takes the steps of all flows: the library's own steppers (Verner's pair for smooth motion), or Boost.Odeint.
enum class FlowStepper { verner, odeint };

/// As jobs write them, in the order of FlowStepper.
inline const std::vector<std::string> flow_stepper_names{"verner", "odeint"};

struct Job {
    std::filesystem::path source;  ///< absolute path of the job file
    std::string title;
    ModelJob model;
    std::uint64_t seed = 1;
    double section_phase = 0.0;                    ///< [rad], forced models
    std::optional<SectionPlaneJob> section_plane;  ///< autonomous models
    std::vector<DataJob> data;
    std::optional<OrbitsJob> orbits;
    std::optional<PeriodicJob> periodic;
    std::optional<EstimateJob> estimate;
    std::vector<ReferenceJob> reference;
    SeriesOutput series_output = SeriesOutput::h5;
    FlowStepper stepper = FlowStepper::verner;  ///< model.system takes its steps
};

}  // namespace orbid::apps
