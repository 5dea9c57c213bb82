#pragma once

#include <Random123/philox.h>

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace orbid::estimator {

/// Purposes of random numbers in this and higher modules. Streams of different purpose are independent; the values are
/// part of what a seed means and never change.
enum class RandomPurpose : std::uint64_t {
    initial_state = 1,
    reading_noise = 2,
    range_probe = 3,
    posterior_sample = 4,  ///< index = chain
    multi_start = 5,       ///< index = start
    prediction_draw = 6,   ///< index = draw
    campaign_draw = 7,     ///< index = what is drawn
    resampling = 8,        ///< index = column of the record
    bootstrap = 9          ///< index = replicate, residual and group
};

/// Random numbers that depend on (seed, purpose, index, position) alone: any order of drawing, on any thread, gives the
/// same numbers. Philox-4x64-10 (Salmon et al. 2011): key (seed, purpose), counter (block, index).
///
/// A stream has 2^64 blocks of four numbers. Copies continue independently from the same position.
class RandomStream {
public:
    RandomStream(std::uint64_t seed, RandomPurpose purpose, std::uint64_t index)
        : key_{{seed, static_cast<std::uint64_t>(purpose)}}, index_(index) {}

    /// 64 random bits.
    [[nodiscard]] std::uint64_t bits() {
        if (used_ == 4) {
            block_ = block(next_block_++);
            used_ = 0;
        }
        return block_[used_++];
    }

    /// Uniform in the open interval (0, 1): midpoints of 2^52 equal cells, so that neither 0 nor 1 can occur.
    [[nodiscard]] double uniform() { return unit(bits()); }
    [[nodiscard]] double uniform(double lower, double upper) { return lower + (upper - lower) * uniform(); }

    /// Normal with mean 0 and sd 1 by Box and Muller, both halves used: exact up to rounding, |x| below 8.6.
    [[nodiscard]] double normal() {
        if (has_spare_) {
            has_spare_ = false;
            return spare_;
        }
        const double radius = std::sqrt(-2.0 * std::log(uniform()));
        const double angle = 2.0 * std::numbers::pi * uniform();
        spare_ = radius * std::sin(angle);
        has_spare_ = true;
        return radius * std::cos(angle);
    }

private:
    static double unit(std::uint64_t bits) { return (static_cast<double>(bits >> 12) + 0.5) * 0x1p-52; }

    [[nodiscard]] std::array<std::uint64_t, 4> block(std::uint64_t number) const {
        const r123::Philox4x64::ctr_type counter{{number, index_, 0, 0}};
        const auto random = r123::Philox4x64()(counter, key_);
        return {random[0], random[1], random[2], random[3]};
    }

    r123::Philox4x64::key_type key_;
    std::uint64_t index_;
    std::uint64_t next_block_ = 0;
    std::array<std::uint64_t, 4> block_{};
    std::size_t used_ = 4;
    double spare_ = 0.0;
    bool has_spare_ = false;
};

}  // namespace orbid::estimator
