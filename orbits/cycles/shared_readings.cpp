#include "orbits/cycles/shared_readings.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <utility>

#include "orbits/cycles/common_errors.hpp"

namespace orbid::orbits {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

namespace {

// What (value, time) of a map get from the error of a neighbour's image and of the neighbour, shape (n + 1, n + 1).
struct Shares {
    MatrixXd image, start;
};

Shares shares(const ManifoldMap& map, Index neighbour, const VectorXd& signs) {
    const Index n = map.value.size();
    const double weight = map.weights[neighbour];
    Shares result{MatrixXd::Zero(n + 1, n + 1), MatrixXd::Zero(n + 1, n + 1)};
    result.image.topLeftCorner(n, n).diagonal().setConstant(weight);
    result.start.topLeftCorner(n, n) = -weight * map.fitted.image;
    double of_time = weight;
    VectorXd time_slope = map.fitted.time;
    if (map.backward_weights.size() > 0) {
        // Across the images' direction the map is as fitted, along it and in time as read backwards.
        of_time = map.backward_weights[neighbour];
        time_slope = (map.time_slope.transpose() * map.along).transpose();
        const MatrixXd along = map.unit * map.measure.transpose();
        const MatrixXd across = MatrixXd::Identity(n, n) - along;
        result.image.topLeftCorner(n, n) = weight * across + of_time * along;
        result.start.topLeftCorner(n, n) = across * result.start.topLeftCorner(n, n) - of_time * map.jacobian();
    }
    result.image(n, n) = of_time;
    result.start(n, n) = -of_time;
    result.start.row(n).head(n) = -of_time * time_slope.transpose();
    result.image.leftCols(n) *= signs.asDiagonal();
    result.start.leftCols(n) *= signs.asDiagonal();
    return result;
}

}  // namespace

ReadingShares errors_by_readings(const SectionPoints& section, const std::vector<ManifoldMap>& maps,
                                 const MatrixXd& response) {
    const Index n = section.dimension(), records = response.rows();
    const VectorXd ones = VectorXd::Ones(n);
    std::map<std::size_t, MatrixXd> parts;  // by point: shape (records, n + 1)
    const auto add = [&](std::size_t point, const MatrixXd& share) {
        const auto [place, first] = parts.try_emplace(point);
        if (first) place->second = MatrixXd::Zero(records, n + 1);
        place->second += share;
    };
    for (std::size_t j = 0; j < maps.size(); ++j) {
        const MatrixXd own = response.middleCols(static_cast<Index>(j) * (n + 1), n + 1);
        for (Index i = 0; i < maps[j].weights.size(); ++i) {
            const Neighbour& neighbour = maps[j].support[static_cast<std::size_t>(i)];
            const Shares share = shares(maps[j], i, neighbour.mirrored ? section.signs() : ones);
            add(neighbour.index + 1, own * share.image);
            add(neighbour.index, own * share.start);
        }
    }
    ReadingShares result;
    result.points.reserve(parts.size());
    result.shares.resize((n + 1) * std::ssize(parts), records);
    for (const auto& [point, part] : parts) {
        result.shares.middleRows((n + 1) * std::ssize(result.points), n + 1) =
            (part * section.error_root(point)).transpose();
        result.points.push_back(point);
    }
    return result;
}

namespace {

// The covariance of one record of a cycle with the records of all.
class SharedCovariance {
public:
    explicit SharedCovariance(const std::vector<ReadingShares>& readings) : readings_(readings) {
        std::size_t points = 0;
        for (std::size_t c = 0; c < readings.size(); ++c) {
            if (readings[c].points.empty()) continue;
            points = std::max(points, readings[c].points.back() + 1);
            each_ = readings[c].shares.rows() / std::ssize(readings[c].points);
            for (Index record = 0; record < readings[c].shares.cols(); ++record)
                origins_.emplace_back(c, record);
        }
        spread_ = VectorXd::Zero(static_cast<Index>(points) * each_);
    }

    [[nodiscard]] Index records() const { return std::ssize(origins_); }
    [[nodiscard]] Index columns() const { return spread_.size(); }

    [[nodiscard]] double variance(Index record) const {
        const auto [cycle, own] = origins_[static_cast<std::size_t>(record)];
        return readings_[cycle].shares.col(own).squaredNorm();
    }

    [[nodiscard]] VectorXd with(Index record) {
        const auto [cycle, own] = origins_[static_cast<std::size_t>(record)];
        const ReadingShares& pivot = readings_[cycle];
        for (std::size_t k = 0; k < pivot.points.size(); ++k)
            spread_.segment(place(pivot, k), each_) =
                pivot.shares.col(own).segment(static_cast<Index>(k) * each_, each_);
        VectorXd result(records());
        Index first = 0;
        for (const ReadingShares& other : readings_) {
            VectorXd met(other.shares.rows());
            for (std::size_t k = 0; k < other.points.size(); ++k)
                met.segment(static_cast<Index>(k) * each_, each_) = spread_.segment(place(other, k), each_);
            result.segment(first, other.shares.cols()) = other.shares.transpose() * met;
            first += other.shares.cols();
        }
        for (std::size_t k = 0; k < pivot.points.size(); ++k)
            spread_.segment(place(pivot, k), each_).setZero();
        return result;
    }

private:
    [[nodiscard]] Index place(const ReadingShares& shares, std::size_t k) const {
        return static_cast<Index>(shares.points[k]) * each_;
    }

    const std::vector<ReadingShares>& readings_;
    std::vector<std::pair<std::size_t, Index>> origins_;  // of every record: its cycle, and its place there
    Index each_ = 1;                                      // errors of a point
    VectorXd spread_;                                     // zero between calls
};

}  // namespace

void share_readings(const std::vector<ReadingShares>& readings, std::vector<Cycle>& cycles) {
    SharedCovariance covariance(readings);
    if (covariance.records() == 0) return;
    VectorXd sd(covariance.records());
    for (Index record = 0; record < sd.size(); ++record)
        sd[record] = std::sqrt(covariance.variance(record));
    const MatrixXd root = common_root(sd, covariance.columns(), [&](Index record) { return covariance.with(record); });
    Index first = 0;
    for (std::size_t c = 0; c < readings.size(); ++c) {
        const Index own = readings[c].shares.cols();
        if (own > 0) cycles[c].common = root.middleRows(first, own);
        first += own;
    }
}

}  // namespace orbid::orbits
