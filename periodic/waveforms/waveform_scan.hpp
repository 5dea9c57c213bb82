#pragma once

#include <optional>
#include <vector>

#include "models/system/system.hpp"
#include "periodic/orbit/eigen_names.hpp"
#include "periodic/orbit/orbit.hpp"
#include "periodic/waveforms/waveform_curve.hpp"
#include "periodic/waveforms/waveform_record.hpp"

namespace orbid::periodic {

/// How a record fits an orbit.
struct WaveformPlace {
    double phase = 0.0;   ///< [rad]; the known one, or the best of a scan, accurate to 1.5 degrees
    VectorXd offsets;     ///< shape (channels); known ones, or the mean errors
    double misfit = 0.0;  ///< mean square error over the variance of the readings
    VectorXd size;        ///< shape (n): largest |x| along the orbit, 2 pi for angles
};

/// A record, and the model at one theta whose orbits it is compared with. Everything is kept by reference.
struct WaveformCase {
    const models::System& system;
    const VectorXd& theta;  ///< all parameters of the system, in their domains, shape (q)
    const WaveformRecord& record;
    const std::vector<WaveformChannel>& channels;
    const models::FlowOptions& flow;

    [[nodiscard]] bool forced() const { return system.kind() == models::Kind::forced; }
};

/// Compares a record with orbits. Every phase that is not known is tried, 256 per period of the forcing; unknown
/// offsets are the mean errors there.
class WaveformScan {
public:
    explicit WaveformScan(const WaveformCase& of);

    /// @return nothing when the orbit cannot be followed
    [[nodiscard]] std::optional<WaveformPlace> place(const PeriodicOrbit& orbit, const PhaseOrigin& origin) const;

    /// Mean reading of every channel, 0 without one.
    [[nodiscard]] const VectorXd& means() const { return mean_; }

private:
    /// Errors of one channel at one phase.
    [[nodiscard]] std::vector<double> errors(std::size_t channel, const MatrixXd& table, double time,
                                             double share) const;
    void try_phase(const MatrixXd& table, double time, double turn, double phase, WaveformPlace& best) const;
    [[nodiscard]] bool reads_angle(std::size_t channel) const;

    WaveformCase of_;
    std::vector<Index> samples_;
    VectorXd variance_;
    VectorXd mean_;
};

}  // namespace orbid::periodic
