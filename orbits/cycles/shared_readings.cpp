#include "orbits/cycles/shared_readings.hpp"

#include <algorithm>
#include <cstddef>
#include <map>

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

Eigen::SparseMatrix<double> errors_by_readings(const SectionPoints& section, const std::vector<ManifoldMap>& maps,
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
    std::vector<Eigen::Triplet<double>> entries;
    entries.reserve(parts.size() * static_cast<std::size_t>((n + 1) * records));
    for (const auto& [point, part] : parts) {
        const MatrixXd moved = part * section.error_root(point);
        for (Index k = 0; k <= n; ++k)
            for (Index record = 0; record < records; ++record)
                if (moved(record, k) != 0.0)
                    entries.emplace_back(static_cast<Index>(point) * (n + 1) + k, record, moved(record, k));
    }
    Eigen::SparseMatrix<double> result(static_cast<Index>(section.size()) * (n + 1), records);
    result.setFromTriplets(entries.begin(), entries.end());
    return result;
}

void share_readings(const std::vector<Eigen::SparseMatrix<double>>& readings, std::vector<Cycle>& cycles) {
    Index records = 0, rows = 0;
    for (const auto& own : readings) {
        records += own.cols();
        rows = std::max(rows, own.rows());
    }
    if (records == 0) return;
    std::vector<Eigen::Triplet<double>> entries;
    Index first = 0;
    for (const auto& own : readings) {
        for (Index record = 0; record < own.outerSize(); ++record)
            for (Eigen::SparseMatrix<double>::InnerIterator entry(own, record); entry; ++entry)
                entries.emplace_back(entry.row(), first + record, entry.value());
        first += own.cols();
    }
    Eigen::SparseMatrix<double> all(rows, records);
    all.setFromTriplets(entries.begin(), entries.end());
    const MatrixXd root = common_root(all);
    first = 0;
    for (std::size_t c = 0; c < readings.size(); ++c) {
        if (readings[c].cols() > 0) cycles[c].common = root.middleRows(first, readings[c].cols());
        first += readings[c].cols();
    }
}

}  // namespace orbid::orbits
