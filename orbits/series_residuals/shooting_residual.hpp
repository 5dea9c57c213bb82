#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "orbits/records/error_form.hpp"
#include "orbits/records/series.hpp"
#include "orbits/series_residuals/continuity.hpp"
#include "orbits/series_residuals/input_delay.hpp"
#include "orbits/series_residuals/shooting_plan.hpp"

#pragma GCC visibility push(default)

namespace orbid::orbits {

struct ProcessNoise;

/// The states of a record whose readings do not tell them one by one; residuals with the same start share them.
struct FollowedSeries {
    std::vector<Eigen::MatrixXd> states;  ///< by segment of the series, shape (n, samples); none: nothing is followed
    Eigen::VectorXd reading_sd;           ///< shape (rows of the series): the largest of all segments
    Eigen::VectorXd theta;                ///< shape (q): parameters that suit the first of them
};

struct ShootingOptions {
    std::string name = "series";        ///< prefix of group names: "series.phi", "series.matching.phi"
    std::vector<std::string> observe;   ///< coordinates of the series to fit; empty = all
    std::vector<std::size_t> segments;  ///< indices of the segments to fit; empty = all
    models::Sensor sensor;              ///< how the series was read
    /// One per observed coordinate; empty = all estimated. For an angle_difference sensor the angle's applies to both
    /// readings, and the rate's is not read.
    std::vector<estimator::ErrorScale> errors;
    std::vector<ErrorForm> forms;  ///< likewise; empty = all normal with one sd
    Continuity matching;
    /// Sampling intervals (sections) from node to node, > 0; 0: chosen by how errors grow, see interval(), and 1 for a
    /// diffusion. Readings between nodes count as if no noise had acted since the node.
    Eigen::Index interval = 0;
    /// Models with measured inputs: one signal per segment of the series, see SeriesResidualOptions::inputs.
    std::vector<std::shared_ptr<const models::InputSignal>> inputs;
    Eigen::VectorXd start;               ///< estimator's parameters for the guess of nodes; empty = base
    std::vector<Eigen::MatrixXd> nodes;  ///< known nodes per fitted segment, shape (n, nodes); empty: from the data
    /// The highest accuracy used; in loose stages a small share of the matching sd is enough.
    models::FlowOptions flow{1e-12, 1e-12, 100000};
    /// Where states must be followed (needs_tracking()): what is known of the first one of each segment, shape (n), nan
    /// where nothing is; empty: nothing at all.
    Eigen::VectorXd first_state = {};
    std::optional<InputDelay> delay = {};  ///< of the inputs, which are given undelayed
    /// States that a residual of the same series has followed from the same start; nothing: they are followed anew.
    std::shared_ptr<const FollowedSeries> followed = {};
    /// Grows by what it costs to follow them, see track_states(); not kept. nullptr: not counted.
    std::uint64_t* following_work = nullptr;
};

/// The recorded series itself by multiple shooting (Bock 1987, Baake 1992): nodes s_i along every segment,
///
///     e = y_k - sensor(Phi(s_i, t_i -> t_k; theta))    for all readings of interval i
///     s_{i+1} = Phi(s_i, t_i -> t_{i+1}; theta)        exactly or with errors of their own (Continuity)
///
/// One block per node, chained along a segment; latent states: the node. Sections of forced models and maps, samples,
/// and crossings with times of autonomous flows as samples at those times. For an angle_difference sensor the residuals
/// are the two angle readings, whose errors are independent, not the angle and the quotient, which share one. Their
/// group is "<name>.<angle>", with floor step / sqrt 12. Missing samples have no record; angles are compared modulo a
/// turn. Groups: one per observed coordinate, then "<name>.matching.<coordinate>" for every coordinate of the model. Of
/// a diffusion "<name>.noise.<coordinate>" for every one that noise enters, whose scale is the root of the diffusion.
///
/// Phases of nodes are that of the section, or series.phase + omega t; derivatives to an estimated omega are complete
/// in both. A failed flow (as in grazing) fails only its own block. A transient that ends in standstill keeps its tail:
/// the flow sticks there and X is singular, but the readings still count.
///
/// Readings by formulas (Sensor::Type::function) and those of few coordinates do not tell the state at a node. There
/// the nodes are followed along the record at the start, see track_states().
///
/// Continuity begins loose, at the root mean square defect of the nodes guessed from the data. update_active_set()
/// tightens it. Sets are intermediate stages until the requested tightness is reached.
class ShootingResidual final : public estimator::Residual {
public:
    /// @throws DataError naming value and rule: segments without a reading, sections of an autonomous flow without
    ///         times, an unread coordinate that no slope determines (sections) when no nodes are given, an
    ///         angle_difference sensor whose angle is not observed or with known sds, log-normal or relative errors of
    ///         an angle, autoregressive errors (they would end at every node).
    /// @throws std::invalid_argument for coordinates or segments that do not exist or are named twice, wrong lengths,
    ///         interval < 0, measured inputs that are missing.
    ShootingResidual(std::shared_ptr<const models::System> system, models::ParameterBinding binding, Series series,
                     ShootingOptions options);

    /// The same residual with other matching and the active blocks of a set, started from these latent states and
    /// parameters of the estimator (empty: its own). The data are shared.
    /// @param held  scales of the first groups, which are fixed there; nan: as it is.
    [[nodiscard]] ShootingResidual with(const Continuity& matching, const estimator::ActiveSet& active,
                                        std::vector<Eigen::VectorXd> latents, const Eigen::VectorXd& theta = {},
                                        const std::vector<double>& held = {}) const;

    [[nodiscard]] std::string_view type() const override { return "series"; }
    [[nodiscard]] const std::vector<estimator::Group>& groups() const override { return initial_.groups; }
    [[nodiscard]] const std::vector<estimator::BlockLayout>& layout() const override { return initial_.layout; }
    [[nodiscard]] estimator::LatentStructure structure() const override { return estimator::LatentStructure::chain; }
    [[nodiscard]] std::vector<Eigen::VectorXd> initial_latents() const override { return initial_.latents; }
    [[nodiscard]] estimator::ActiveSet initial_set() const override { return initial_; }
    [[nodiscard]] std::vector<estimator::BlockValue> evaluate(const estimator::ActiveSet& active,
                                                              const Eigen::VectorXd& theta,
                                                              const std::vector<Eigen::VectorXd>& latents,
                                                              bool derivatives) const override;
    estimator::RefreshReport update_active_set(estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                               const std::vector<Eigen::VectorXd>& latents,
                                               const Eigen::VectorXd& scales) const override;

    /// Continuity defects d = s_{i+1} - Phi(s_i), per coordinate of the model.
    struct Defect {
        Eigen::VectorXd rms;      ///< shape (n)
        Eigen::VectorXd typical;  ///< 1.4826 times the median of its absolute value: the sd if it were normal
        std::size_t large = 0;    ///< intervals with a coordinate beyond three of the given `sd`
        std::size_t count = 0;    ///< intervals
    };
    /// @param sd  shape (n), > 0; empty: the matching sds of the set.
    [[nodiscard]] Defect defect(const estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                                const std::vector<Eigen::VectorXd>& latents, const Eigen::VectorXd& sd = {}) const;

    /// Sampling intervals from node to node, as given or chosen.
    [[nodiscard]] Eigen::Index interval() const { return data_->interval; }
    /// Size of each coordinate's range, shape (n). In this unit matching is equally tight for all.
    [[nodiscard]] const Eigen::VectorXd& range() const { return data_->range; }
    /// The same of what is read, by group of readings.
    [[nodiscard]] double reading_range(std::size_t group) const { return data_->reading_range[group]; }
    /// Indices of the segments that are fitted.
    [[nodiscard]] const std::vector<std::size_t>& fitted() const { return data_->options.segments; }
    /// Matching sds of a set, shape (n); 0 when matching is by constraints. Of a diffusion those over an interval of
    /// the usual duration: of coordinates that integrate it, of what the noise they integrate does not tell of them.
    [[nodiscard]] Eigen::VectorXd matching_sd(const estimator::ActiveSet& active) const {
        return active.memory.front()[tightness] * unit_;
    }
    /// The same at scales of the groups, shape (groups).
    [[nodiscard]] Eigen::VectorXd matching_sd(const Eigen::VectorXd& scales) const;
    /// How many groups are those of readings; those of matching come after them.
    [[nodiscard]] std::size_t reading_groups() const { return data_->reading_range.size(); }
    /// The coordinates that noise enters, in the order of their groups; empty unless matching is a diffusion.
    [[nodiscard]] std::vector<Eigen::Index> noisy_coordinates() const;
    [[nodiscard]] const Continuity& matching() const { return matching_; }
    /// Largest sd of a reading over its range, as far as known.
    [[nodiscard]] double noise(const estimator::ActiveSet& active) const {
        return active.memory.front()[reading_noise];
    }
    /// Whether courses fold within the errors of readings: sections with noise, matched exactly. See exact_matching().
    [[nodiscard]] bool folds(const estimator::ActiveSet& active) const {
        return matching_.is_exact_with_slack() && !sampled() && noise(active) > noisy_readings;
    }
    /// Makes exact matching of a set as tight as its scales of readings ask for, where these are far smaller than when
    /// it became as tight as it is.
    /// @return  whether they are.
    [[nodiscard]] bool tighten(estimator::ActiveSet& active) const;
    [[nodiscard]] const Series& series() const { return data_->series; }
    [[nodiscard]] const ShootingPlan& plan() const { return data_->plan; }
    /// States that were followed at the start; none where readings tell them.
    [[nodiscard]] const std::shared_ptr<const FollowedSeries>& followed() const { return data_->followed; }
    /// What evaluations have cost so far, of this residual and of those that share its data: steps of the integrator,
    /// times one more than the directions of its derivatives. The same on every machine and with any number of threads.
    [[nodiscard]] std::uint64_t work() const { return data_->work.load(std::memory_order_relaxed); }

private:
    /// What copies with other matching share.
    struct Data {
        /// One per segment of the series, each with its measured inputs; a single one without inputs.
        std::vector<std::shared_ptr<const models::System>> systems;
        models::ParameterBinding binding;
        Series series;
        ShootingOptions options;
        std::vector<ObservedCoordinate> observed;
        models::Sensor instant_sensor;  ///< what is read at one instant: a difference sensor reads its angle twice
        Eigen::Index interval = 1;
        Eigen::VectorXd range;
        std::vector<double> reading_range;  ///< per group of readings
        /// States at all samples of each segment, where they are followed.
        std::shared_ptr<const FollowedSeries> followed = std::make_shared<const FollowedSeries>();
        ShootingPlan plan;
        Eigen::VectorXd omega_slopes;                ///< d omega / d(parameter), per parameter of the binding
        mutable std::atomic<std::uint64_t> work{0};  ///< see work()
        Eigen::VectorXd delay_slopes;  ///< d delay / d(parameter) likewise; the series' phase is minus the start's

        /// By how much the clock of the inputs is earlier than at the start.
        [[nodiscard]] double later(const Eigen::VectorXd& all) const {
            return options.delay ? all[options.delay->parameter] + series.phase : 0.0;
        }

        [[nodiscard]] const models::System& system() const { return *systems.front(); }
    };
    /// Places in the memory of a set: tightness of matching, now and at the end, and the sd of readings over their
    /// ranges, as far as known.
    enum Memory : Eigen::Index { tightness, final_tightness, reading_noise, memory_size };
    struct Chunk;
    struct Simulated;

    static std::shared_ptr<Data> read(std::shared_ptr<const models::System> system, models::ParameterBinding binding,
                                      Series series, ShootingOptions options);
    static void follow_states(Data& data, const Eigen::VectorXd& all);
    void check_matching() const;
    void take_ranges(Data& data);
    void guess_nodes(const Eigen::VectorXd& all);
    void find_process_noise();
    [[nodiscard]] Eigen::VectorXd noise_scale_unit() const;
    void make_groups();
    void make_matching_groups();
    void set_link_errors(std::size_t node, estimator::BlockLayout& block) const;
    void whiten(std::size_t pattern, estimator::BlockValue& value) const;
    void make_layout();
    void begin_matching(const Eigen::VectorXd& theta);
    void apply_matching(estimator::ActiveSet& active) const;
    void find_noise(estimator::ActiveSet& active) const;
    void predict_scales(estimator::ActiveSet& active, const Eigen::VectorXd& theta) const;
    void read_scales(estimator::ActiveSet& active, const Eigen::VectorXd& theta,
                     const std::vector<Eigen::VectorXd>& latents, bool loose) const;
    [[nodiscard]] models::FlowOptions stage_flow(const estimator::ActiveSet& active) const;
    [[nodiscard]] Eigen::VectorXd start_theta() const;
    [[nodiscard]] Eigen::VectorXd predicted_noise(const Eigen::VectorXd& all) const;
    void evaluate(const Chunk& chunk, const Eigen::VectorXd& all, const std::vector<Eigen::VectorXd>& latents,
                  bool derivatives, std::vector<estimator::BlockValue>& values) const;
    [[nodiscard]] Simulated simulated(const Chunk& chunk, const Eigen::VectorXd& all,
                                      const std::vector<Eigen::VectorXd>& latents, bool derivatives) const;
    void set_sensitivity(const Simulated& run, Eigen::Index k, std::size_t node, Eigen::Index instant,
                         Eigen::MatrixXd& result) const;
    [[nodiscard]] estimator::BlockValue value(const Simulated& run, Eigen::Index k, std::size_t b,
                                              const std::vector<Eigen::VectorXd>& latents, bool derivatives) const;
    [[nodiscard]] const models::System& system_of(std::size_t segment) const {
        return *data_->systems[data_->systems.size() == 1 ? 0 : segment];
    }

    [[nodiscard]] bool sampled() const { return data_->series.sampling == Series::Sampling::samples; }

    std::shared_ptr<const Data> data_;
    Continuity matching_;
    estimator::ActiveSet initial_;  ///< memory: see Memory
    Eigen::VectorXd unit_;          ///< matching sds over their tightness: the ranges, or in the requested proportions
    std::shared_ptr<const ProcessNoise> noise_;  ///< of a diffusion, else none
};

}  // namespace orbid::orbits

#pragma GCC visibility pop
