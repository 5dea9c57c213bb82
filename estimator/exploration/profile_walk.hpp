#pragma once

#include <cmath>
#include <cstddef>
#include <vector>

#include "estimator/exploration/conditional_estimate.hpp"
#include "estimator/exploration/profile.hpp"
#include "estimator/interface/not_finite.hpp"

namespace orbid::estimator {

/// A point of a profile.
struct ProfileNode {
    double u = 0.0;
    double objective = 0.0;
    double root = 0.0;  ///< signed root, >= 0 away from the minimum
    ConditionalStart at;
};

/// The profile on one side of its minimum.
struct ProfileSide {
    std::vector<ProfileNode> nodes;  ///< in the order of distance from the minimum, which is the first
    std::vector<double> failed;
    ProfileEnd end = ProfileEnd::found;
    double limit = nan_value;  ///< the end, in u
    int evaluations = 0;
};

/// Walks from the minimum of a profile to one end of its interval.
class ProfileWalk {
public:
    ProfileWalk(const Conditional& conditional, const Unknown& unknown, const EstimateOptions& estimate,
                const ProfileOptions& options, const ProfileNode& centre, double threshold, int direction)
        : conditional_(conditional),
          unknown_(unknown),
          estimate_(estimate),
          options_(options),
          target_(std::sqrt(threshold)),
          direction_(direction),
          limit_(direction < 0 ? unknown.lower : unknown.upper),
          sd_(unknown.sd > 0.0 ? unknown.sd : 0.1 * unknown.size) {
        side.nodes.push_back(centre);
    }

    void find_end();
    /// Fills the gaps of the signed root within the interval.
    void draw_curve();

    ProfileSide side;

private:
    bool visit(double u);
    [[nodiscard]] bool stopped();
    void close_in(std::size_t inner, std::size_t outer);
    void end_at(ProfileEnd end, double limit) {
        side.end = end;
        side.limit = limit;
    }

    const Conditional& conditional_;
    const Unknown& unknown_;
    const EstimateOptions& estimate_;
    const ProfileOptions& options_;
    double target_;
    int direction_;
    double limit_;
    double sd_;
    std::size_t visited_ = 0;
};

}  // namespace orbid::estimator
