#pragma once

#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "estimator/interface/residual.hpp"
#include "models/arithmetic/matrix_layout.hpp"
#include "models/system/system.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/waveforms/steady_state_residual.hpp"
#include "periodic/waveforms/waveform_record.hpp"

#pragma GCC visibility push(default)

namespace orbid::periodic {

struct WaveformOptions {
    std::string name = "waveform";          ///< prefix of group names: "waveform.x"
    std::vector<WaveformChannel> channels;  ///< at least one, of different coordinates
    /// Full covariances; groups = positions in `channels`. Their channels are read at the same samples.
    std::vector<estimator::JointCovariance> covariances;
    Eigen::VectorXd start;      ///< the estimator's vector at which the first solutions are computed
    double maximum_move = 0.1;  ///< of a point of an orbit from its prediction, relative to the orbit's size; > 0
    models::FlowOptions flow{1e-12, 1e-12, 100000};
};

/// Measured periodic steady states under several excitations against computed ones (H. J. Verbeek 1995):
///
///     e_k = y_k - h(x*(phase + omega t_k; theta)) - offset,   x* periodic: x*(tau + 2 pi p) = x*(tau)
///
/// One block per record. Its residuals are the samples of the first channel in time, then those of the second, ...;
/// missing samples have none. Groups: one per channel, "<name>.<coordinate>", shared by all excitations, ordered in
/// time. Unknown phases and offsets are latent states of their block, in this order. They belong to one record each, so
/// error scales integrate them out at the cost of a block, however many records there are. As parameters they would be
/// a dense row each.
///
/// x* is followed as SteadyStateResidual says. The orbit of a record at the start: find_waveform_start(). Derivatives
/// are those of the computed prediction. They combine the sensitivities of the orbit, carried by the flow between its
/// points, the motion of the places with omega (or T), and the sensor.
class WaveformResidual final : public SteadyStateResidual {
public:
    /// A record whose orbit is not found at `start` is inactive from the beginning: start_status() says why.
    /// @throws std::invalid_argument naming value and rule. Model: a map, or one with measured inputs. No record or
    ///         channel, bindings and starts of wrong lengths, options out of range.
    /// @throws models::DataError naming record, value and rule. Data: wrong shapes; times that do not ascend; a record
    ///         shorter than its orbit, or with fewer readings than unknown phase and offsets. Orbit: a period out of
    ///         [1, 64] or an autonomous flow with one; T of an autonomous flow not given, or its phase; a phase beyond
    ///         whole turns of the orbit. Errors: intervals that differ by more than 5 % where errors are
    ///         autoregressive; log-normal or relative errors of an angle, log-normal errors of a reading not > 0; known
    ///         sds that are missing; a full covariance of channels that are not read at the same samples. Also
    ///         parameters of `start` outside their domain.
    WaveformResidual(std::shared_ptr<const models::System> system, std::vector<WaveformRecord> records,
                     WaveformOptions options);

    [[nodiscard]] std::string_view type() const override { return "waveform"; }
    [[nodiscard]] estimator::LatentStructure structure() const override;
    [[nodiscard]] std::vector<estimator::JointCovariance> covariances() const override { return options_.covariances; }

    /// Phase and offsets of a record: estimated ones from the latent states, known ones as given.
    struct Alignment {
        double phase = 0.0;       ///< [rad]
        Eigen::VectorXd offsets;  ///< one per channel
    };
    [[nodiscard]] Alignment alignment(std::size_t block, const Eigen::VectorXd& latents) const;
    /// Position of phase (-1) or a channel's offset for each latent state of a block.
    [[nodiscard]] const std::vector<Eigen::Index>& unknowns(std::size_t block) const { return blocks_[block].unknowns; }

    /// Channel and sample of a residual.
    struct Source {
        Eigen::Index channel = 0;
        Eigen::Index sample = 0;  ///< column of the record's values
    };
    [[nodiscard]] const std::vector<Source>& sources(std::size_t block) const { return blocks_[block].sources; }
    [[nodiscard]] const std::vector<WaveformRecord>& records() const { return records_; }
    [[nodiscard]] const std::vector<WaveformChannel>& channels() const { return options_.channels; }
    /// Readings of an orbit at times of a record's clock, shape (channels, m), offsets included; empty if the flow
    /// cannot be followed.
    [[nodiscard]] Eigen::MatrixXd readings(const estimator::ActiveSet& active, std::size_t block,
                                           const Eigen::VectorXd& theta, const PeriodicOrbit& orbit,
                                           const Eigen::VectorXd& latents, std::span<const double> times) const;

private:
    struct Block {
        std::vector<Source> sources;
        std::vector<Eigen::Index> unknowns;
    };

    void check_model() const;
    void check_channels() const;
    void check_record(const WaveformRecord& record) const;
    void check_readings(const WaveformRecord& record) const;
    void check_covariances() const;
    void make_groups();
    [[nodiscard]] Block make_block(const WaveformRecord& record) const;
    [[nodiscard]] estimator::BlockLayout make_layout(const WaveformRecord& record, const Block& block) const;
    [[nodiscard]] FoundStart find_start(std::size_t block, const Eigen::VectorXd& theta) const override;
    [[nodiscard]] estimator::BlockValue value(std::size_t block, const Known& known, const FollowedOrbit& orbit,
                                              const Eigen::VectorXd& theta, const Eigen::VectorXd& latents,
                                              bool derivatives) const override;
    [[nodiscard]] Eigen::VectorXd starting_latents(std::size_t block, const Known& known) const override;

    std::vector<WaveformRecord> records_;
    WaveformOptions options_;
    std::vector<Block> blocks_;
};

}  // namespace orbid::periodic

#pragma GCC visibility pop
