#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "orbits/records/error_form.hpp"
#include "orbits/records/series.hpp"
#include "orbits/series_residuals/input_delay.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

class ObservedChannels;

/// What is known about one coordinate of the segments' initial states.
struct InitialStateRule {
    enum class Kind {
        estimate,  ///< free, one value per segment
        fixed,     ///< `value` in every segment
        normal,    ///< free, with the prior normal(value, sd): one more record per segment
        parameter  ///< an estimated parameter for each fitted segment, with its own prior and scale
    };
    Kind kind = Kind::estimate;
    double value = 0.0;           ///< fixed: the value; normal: the mean
    double sd = 0.0;              ///< normal: > 0
    std::optional<double> start;  ///< estimate, normal: where the fit starts; empty = from the data
    /// parameter: index into the estimator's vector for every fitted segment, in the order of `segments`.
    std::vector<Eigen::Index> parameters = {};
};

struct SeriesResidualOptions {
    std::string name = "series";                ///< prefix of group names: "series.phi", "series.run1.phi"
    std::vector<std::string> observe;           ///< coordinates of the series to fit; empty = all
    std::vector<std::size_t> segments;          ///< indices of the segments to fit; empty = all
    models::Sensor sensor;                      ///< how the series was read
    std::vector<InitialStateRule> initial;      ///< one per coordinate of the model; empty = all estimated
    std::vector<estimator::ErrorScale> errors;  ///< one per observed coordinate, in that order; empty = all estimated
    std::vector<ErrorForm> forms;               ///< likewise; empty = all normal with one sd
    /// Full covariances; groups = positions in `observe`. Their coordinates share the same samples.
    std::vector<estimator::JointCovariance> covariances;
    /// Models with measured inputs: one signal per segment of the series, on the clock of its times. It covers them,
    /// and the delay of a difference sensor after them. Empty otherwise.
    std::vector<std::shared_ptr<const models::InputSignal>> inputs;
    Eigen::VectorXd start;  ///< estimator's parameters for the guess of initial states; empty = base
    models::FlowOptions flow;
    std::optional<InputDelay> delay = {};  ///< of the inputs, which are given undelayed
};

/// How well a model predicts a segment.
struct SegmentPrediction {
    std::size_t segment = 0;
    estimator::BlockStatus status = estimator::BlockStatus::ok;
    Eigen::VectorXd state;        ///< shape (n): the initial state, fitted to this segment where it is free
    Eigen::VectorXd rms;          ///< per observed coordinate, in its unit; nan without samples
    double normalised_rms = 0.0;  ///< of all records, each divided by the sd of its error
    struct Reading {
        Eigen::Index channel = 0;  ///< index into the observed coordinates
        Eigen::Index sample = 0;   ///< column of the segment
        double value = 0.0;
        double error = 0.0;  ///< value minus prediction
    };
    std::vector<Reading> readings{};  ///< all of the segment; none where it could not be simulated
};

/// A sampled series minus its prediction from one initial state per segment (single shooting).
///
///     e_k = y_k - sensor(x(t_k)),   x' = f(x, omega t; theta),   x(t_first) = z
///
/// One block per fitted segment. Its records are the samples of the first observed coordinate in time order, then those
/// of the second, ..., then one record per normal prior of the initial state. Missing samples have no record.
/// Differences of angles lie in (-pi, pi]; formulas of a sensor are not angles. Latent states: the free coordinates of
/// z that are not estimated parameters, in the model's order. Groups: one per observed coordinate
/// ("<name>.<coordinate>", ordered in time), then one per normal prior ("<name>.initial.<coordinate>", scale fixed).
/// Known sds of readings become BlockLayout::deviation.
///
/// Models with measured inputs are simulated on the clock of the series' times; their series.phase is 0. A delay of the
/// inputs may be a parameter, see InputDelay.
///
/// Forced models: the phase at time t is series.phase + omega t. When omega is estimated and a segment does not begin
/// at time 0, its first phase depends on omega. The derivatives for the state sensor include this. A difference
/// sensor's reading depends on the phase, so an estimated omega is refused.
///
/// Derivatives are those of the computed prediction (models::System::flow_with_sensitivities and readings). Parallel
/// over segments, with the same bytes for any number of threads. A failed flow gives BlockStatus::failed.
class SeriesResidual final : public estimator::Residual {
public:
    /// @param binding  which entries of the estimator's vector are which parameters of the system.
    /// @throws DataError naming value and rule: a section instead of samples, coordinates that the series does not
    /// have,
    ///         no segment left, a segment with fewer samples than free coordinates of its initial state, intervals that
    ///         differ between segments by more than 5 %; log-normal or relative errors of an angle, log-normal errors
    ///         of a reading that is not > 0, known sds that the series does not have, a full covariance of coordinates
    ///         that are not read at the same samples, inputs that are not asked for or too short.
    /// @throws std::invalid_argument for coordinates that the model does not have, segments that do not exist or are
    ///         named twice, wrong lengths, sd of a prior not > 0, indices of initial values that no estimated parameter
    ///         has, inputs that are missing.
    SeriesResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding, Series series,
                   SeriesResidualOptions options);

    [[nodiscard]] std::string_view type() const override { return "series"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return groups_; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return layout_; }
    [[nodiscard]] estimator::LatentStructure structure() const override;
    [[nodiscard]] std::vector<estimator::JointCovariance> covariances() const override { return options_.covariances; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override;
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;

    /// Predicts segments at given parameters. All initial coordinates that are not fixed are fitted to the segment
    /// itself, started from the data as in initial_latents(). The method is damped Gauss-Newton on the sum of squares
    /// of errors over their sd, normal priors included. This predicts the course, not its beginning.
    ///
    /// @param scales    shape (groups): s_g, > 0.
    /// @param segments  indices into series().segments, fitted or not.
    /// @param relative  shape (groups), read where errors are relative; empty: their starts.
    [[nodiscard]] std::vector<SegmentPrediction> predict(const Eigen::VectorXd& theta, const Eigen::VectorXd& scales,
                                                         const std::vector<std::size_t>& segments,
                                                         const Eigen::VectorXd& relative = {}) const;

    /// Sd of the error of a record whose prediction is y - e (log-normal: to first order; Student's t, Laplace: scale).
    [[nodiscard]] double error_sd(std::size_t block, Eigen::Index record, double e, double scale,
                                  double relative) const;

    /// Where a record comes from. Priors have no sample: `sample` is -1.
    struct Record {
        Eigen::Index coordinate = 0;  ///< of the model
        Eigen::Index sample = 0;      ///< column of the segment
    };
    [[nodiscard]] const std::vector<Record>& records(std::size_t block) const { return blocks_[block].records; }
    /// What each record compares with: a reading, or the mean of a prior.
    [[nodiscard]] const Eigen::VectorXd& readings(std::size_t block) const { return blocks_[block].observed; }
    [[nodiscard]] std::size_t segment(std::size_t block) const { return blocks_[block].segment; }
    [[nodiscard]] const Series& series() const { return series_; }
    [[nodiscard]] const models::System& system() const { return *system_; }
    /// The complete initial state of a block, shape (n): free coordinates from its latents or from theta, and fixed
    /// ones.
    [[nodiscard]] Eigen::VectorXd state(std::size_t block, const Eigen::VectorXd& theta,
                                        const Eigen::VectorXd& latents) const;
    /// The initial state from the data and the rules' starts, before any estimate, shape (n).
    [[nodiscard]] Eigen::VectorXd guessed_state(std::size_t block) const;
    /// The model coordinates of a block's latents, ascending.
    [[nodiscard]] const std::vector<Eigen::Index>& free_coordinates() const { return free_; }

private:
    struct Block {
        std::size_t segment = 0;
        std::vector<Record> records;
        std::vector<Eigen::Index> rows;  ///< of the segment's values, for each record
        std::vector<int> group;
        Eigen::VectorXd observed;   ///< the reading, or the mean of a prior
        Eigen::VectorXd deviation;  ///< known sds, 1 where none is known
    };
    /// An error over its sd, and the derivative of the ratio with respect to the error.
    struct Standard {
        double value;
        double slope;
    };

    [[nodiscard]] ObservedChannels channels() const;
    void require(bool rule, const std::string& message) const;
    void require_call(bool rule, const std::string& message) const;
    void choose_coordinates();
    void choose_segments();
    void check_binding() const;
    void check_rules() const;
    void check_forms() const;
    void check_covariances() const;
    void make_groups();
    [[nodiscard]] Block make_block(std::size_t segment) const;
    [[nodiscard]] double known_sd(const Segment& data, std::size_t observed, Eigen::Index k) const;
    [[nodiscard]] estimator::BlockLayout make_layout(const Block& block) const;
    [[nodiscard]] Eigen::VectorXd guess(std::size_t segment, const Eigen::VectorXd& all) const;
    [[nodiscard]] Standard standard(const Block& block, Eigen::Index record, double e, double scale,
                                    double relative) const;
    /// The same of all errors e, and with scales and relative errors per group.
    [[nodiscard]] Standard standard(const Block& block, Eigen::Index record, const Eigen::VectorXd& e,
                                    const Eigen::VectorXd& scales, const Eigen::VectorXd& relative) const;
    /// e, e_theta, and e_z with respect to the whole initial state.
    [[nodiscard]] estimator::BlockValue value(const Block& block, const Eigen::VectorXd& all, const Eigen::VectorXd& x0,
                                              bool derivatives) const;
    void add_phase_shift(const Eigen::VectorXd& all, const models::System& system, double first_time,
                         std::span<const double> phases, const Eigen::VectorXd& x0, models::FlowResult& flow) const;
    /// Phase at a time: of the forcing, or on the clock of the inputs.
    [[nodiscard]] double phase(const Eigen::VectorXd& all, double time) const;
    /// Fits the coordinates of x0 that are not fixed to a block. @return the block's value there.
    [[nodiscard]] estimator::BlockValue fit_state(const Block& block, const Eigen::VectorXd& all,
                                                  const Eigen::VectorXd& scales, const Eigen::VectorXd& relative,
                                                  Eigen::VectorXd& x0) const;
    [[nodiscard]] SegmentPrediction predict_one(const Eigen::VectorXd& all, const Eigen::VectorXd& scales,
                                                const Eigen::VectorXd& relative, std::size_t segment) const;
    /// The system, with the inputs of a segment if it has any.
    [[nodiscard]] const models::System& system_of(std::size_t segment) const;
    void give_inputs();

    std::shared_ptr<const models::System> system_;
    std::vector<std::shared_ptr<const models::System>> with_inputs_;  ///< one per segment of the series; or none
    models::ParameterBinding binding_;
    Series series_;
    SeriesResidualOptions options_;
    std::vector<Eigen::Index> row_;       ///< per observed coordinate: row of the segments' values
    std::vector<Eigen::Index> observed_;  ///< per observed coordinate: coordinate of the model
    std::vector<Eigen::Index> free_;      ///< coordinates of the model that are latent
    std::vector<Eigen::Index> given_;     ///< coordinates that are estimated parameters
    std::vector<Eigen::Index> priors_;    ///< coordinates with a normal prior
    double interval_ = 0.0;
    std::vector<estimator::Group> groups_;
    std::vector<estimator::BlockLayout> layout_;
    std::vector<Block> blocks_;
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
