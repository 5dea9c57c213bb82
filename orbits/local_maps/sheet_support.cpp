#include "orbits/local_maps/sheet_support.hpp"

#include <cmath>

namespace orbid::orbits {
namespace {

// An image this far (in turns or ranges) from the nearest neighbour's belongs to another piece of the map.
constexpr double other_piece = 0.25;

}  // namespace

SheetSupport sheet_support(const SectionPoints& points, const NeighbourIndex& grid, const Eigen::MatrixXd& whitening,
                           const Eigen::VectorXd& place, std::size_t neighbours) {
    const Eigen::Index n = points.dimension();
    SheetSupport support;
    support.centre = points.wrapped(place);
    support.reference = Eigen::VectorXd::Zero(n);
    const std::vector<Neighbour> members = grid.nearest(support.centre, neighbours);
    support.z.resize(static_cast<Eigen::Index>(members.size()), n);
    support.values = Eigen::MatrixXd::Zero(support.z.rows(), n + 1);
    Eigen::VectorXd offset(n);
    Eigen::Index kept = 0;
    for (const Neighbour& member : members) {
        bool whole = true;
        for (Eigen::Index d = 0; d < n; ++d) {
            const double sign = member.mirrored ? points.signs()[d] : 1.0;
            const double image = sign * points.point(member.index + 1)[d];
            if (kept == 0) support.reference[d] = image;
            offset[d] = points.difference(sign * points.point(member.index)[d], support.centre[d], d);
            support.values(kept, d) = points.difference(image, support.reference[d], d);
            whole = whole && std::abs(support.values(kept, d)) < other_piece;
        }
        if (whole) {  // the other piece may begin anywhere around, not only beyond the farthest
            if (points.timed()) support.values(kept, n) = points.return_time(member.index);
            support.members.push_back(member);
            support.z.row(kept++) = (whitening * offset).transpose();
        }
        support.kept.push_back(kept);
    }
    return support;
}

}  // namespace orbid::orbits
