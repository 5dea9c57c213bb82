#include "orbits/simulation/attractor_detection.hpp"

#include <cassert>
#include <cmath>

#include "models/definition/parameter.hpp"

namespace orbid::orbits {
namespace {

constexpr int longest_period = 64;
constexpr Eigen::Index watched = 256;  // sections that must repeat: four times the longest period
constexpr double tolerance = 1e-9;     // relative to the range: well above integration error, 1e-12

bool equal(const Eigen::Ref<const Eigen::MatrixXd>& sections, Eigen::Index a, Eigen::Index b,
           const std::vector<bool>& angle, const Eigen::VectorXd& range) {
    for (Eigen::Index i = 0; i < sections.rows(); ++i) {
        double difference = sections(i, a) - sections(i, b);
        if (angle[static_cast<std::size_t>(i)]) difference = models::wrapped(difference);
        if (!(std::abs(difference) <= tolerance * range[i])) return false;
    }
    return true;
}

}  // namespace

std::optional<Capture> captured(const Eigen::Ref<const Eigen::MatrixXd>& sections, const std::vector<bool>& angle,
                                const Eigen::VectorXd& range) {
    const Eigen::Index last = sections.cols() - 1;
    if (last + 1 < watched + longest_period) return std::nullopt;
    for (int period = 1; period <= longest_period; ++period) {
        Eigen::Index k = last;
        while (k >= period && equal(sections, k, k - period, angle, range))
            --k;
        if (last - k >= watched) return Capture{period, k + 1 - period};
    }
    return std::nullopt;
}

Eigen::Index settled_at_last(const Eigen::Ref<const Eigen::MatrixXd>& sections, const std::vector<bool>& angle,
                             const Eigen::VectorXd& range) {
    assert(sections.cols() > 0);
    const Eigen::Index last = sections.cols() - 1;
    Eigen::Index k = last;
    while (k > 0 && equal(sections, k - 1, last, angle, range))
        --k;
    return k;
}

}  // namespace orbid::orbits
