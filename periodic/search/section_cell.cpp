#include "periodic/search/section_cell.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "models/arithmetic/splitmix64.hpp"
#include "periodic/orbit/winding_number.hpp"

namespace orbid::periodic {

SectionCells::SectionCells(const models::System& system, VectorXd size, double edge, std::vector<double> signs)
    : size_(std::move(size)),
      signs_(std::move(signs)),
      around_(static_cast<std::size_t>(system.dimension()), 0.0),
      edge_(edge) {
    for (const Index i : angle_coordinates(system))
        around_[static_cast<std::size_t>(i)] = std::max(2.0, 2.0 * std::floor(0.5 / edge));
}

std::uint64_t SectionCells::name(Eigen::Ref<const VectorXd> x, bool mirrored) const {
    std::uint64_t name = 0;
    for (Index i = 0; i < x.size(); ++i) {
        const auto slot = static_cast<std::size_t>(i);
        const double value = mirrored && !signs_.empty() ? signs_[slot] * x(i) : x(i);
        const double around = around_[slot];
        double number = std::floor(value / size_(i) * (around > 0.0 ? around : 1.0 / edge_) + 0.5);
        if (around > 0.0 && 2.0 * number >= around) number -= around;
        name = models::splitmix64_finalizer(name * 0x9e3779b97f4a7c15U +
                                            static_cast<std::uint64_t>(static_cast<std::int64_t>(number)));
    }
    return name;
}

std::uint64_t cyclic_name(const std::uint64_t* symbols, std::size_t count) {
    std::uint64_t smallest = ~std::uint64_t{0};
    for (std::size_t shift = 0; shift < count; ++shift) {
        std::uint64_t name = 0;
        for (std::size_t j = 0; j < count; ++j)
            name = models::splitmix64_finalizer(name * 0xd1342543de82ef95U + symbols[(j + shift) % count]);
        smallest = std::min(smallest, name);
    }
    return smallest;
}

std::uint64_t itinerary_name(const SectionCells& cells, const MatrixXd& points) {
    std::vector<std::uint64_t> names, mirrored;
    for (Index j = 0; j < points.cols(); ++j) {
        names.push_back(cells.name(points.col(j)));
        mirrored.push_back(cells.mirrored(points.col(j)));
    }
    return std::min(cyclic_name(names.data(), names.size()), cyclic_name(mirrored.data(), mirrored.size()));
}

}  // namespace orbid::periodic
