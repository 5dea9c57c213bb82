#include "orbits/cycles/near_places.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace orbid::orbits {

namespace {

constexpr std::size_t most_gridded = 3;

// Cells are numbered modulo 2^21 per coordinate: cells that far apart share a list, which costs time and nothing else.
std::uint64_t key_of(const std::array<std::int64_t, most_gridded>& cell) {
    std::uint64_t key = 0;
    for (const std::int64_t number : cell)
        key = (key << 21) | (static_cast<std::uint64_t>(number) & 0x1fffffU);
    return key;
}

double turned(double difference) {
    return difference - std::nearbyint(difference);
}

}  // namespace

NearPlaces::NearPlaces(Eigen::MatrixXd places, std::vector<double> radii, std::vector<char> angle)
    : places_(std::move(places)), radii_(std::move(radii)), angle_(std::move(angle)) {
    gridded_ = std::min(angle_.size(), most_gridded);
    // A ball touches at most two cells along a coordinate.
    const double largest = radii_.empty() ? 1.0 : *std::max_element(radii_.begin(), radii_.end());
    for (std::size_t d = 0; d < gridded_; ++d) {
        const double per_unit = 0.5 / largest;
        cells_per_unit_.push_back(angle_[d] ? std::max(1.0, std::floor(per_unit)) : per_unit);
    }
    for (std::size_t i = 0; i < radii_.size(); ++i)
        enter(static_cast<std::uint32_t>(i));
}

std::int64_t NearPlaces::cell(double value, std::size_t coordinate) const {
    const auto number = static_cast<std::int64_t>(std::floor(value * cells_per_unit_[coordinate]));
    if (!angle_[coordinate]) return number;
    const auto around = static_cast<std::int64_t>(cells_per_unit_[coordinate]);
    return ((number % around) + around) % around;
}

void NearPlaces::enter(std::uint32_t place) {
    std::array<std::vector<std::int64_t>, most_gridded> touched;
    touched.fill({0});
    for (std::size_t d = 0; d < gridded_; ++d) {
        const double centre = places_(static_cast<Eigen::Index>(d), place);
        // a little more than the ball: differences are rounded
        const double within = 1.000001 * radii_[place];
        touched[d] = {cell(centre - within, d), cell(centre, d), cell(centre + within, d)};
        std::sort(touched[d].begin(), touched[d].end());
        touched[d].erase(std::unique(touched[d].begin(), touched[d].end()), touched[d].end());
    }
    for (const std::int64_t a : touched[0])
        for (const std::int64_t b : touched[1])
            for (const std::int64_t c : touched[2])
                cells_[key_of({a, b, c})].push_back(place);
}

bool NearPlaces::contains(const double* state) const {
    std::array<std::int64_t, most_gridded> home{0, 0, 0};
    for (std::size_t d = 0; d < angle_.size(); ++d)
        if (!std::isfinite(state[d])) return false;
    for (std::size_t d = 0; d < gridded_; ++d)
        home[d] = cell(state[d], d);
    const auto found = cells_.find(key_of(home));
    if (found == cells_.end()) return false;
    return std::any_of(found->second.begin(), found->second.end(), [&](std::uint32_t place) {
        double distance2 = 0.0;
        for (std::size_t d = 0; d < angle_.size(); ++d) {
            const double r = state[d] - places_(static_cast<Eigen::Index>(d), place);
            const double difference = angle_[d] ? turned(r) : r;
            distance2 += difference * difference;
        }
        return distance2 <= radii_[place] * radii_[place];
    });
}

}  // namespace orbid::orbits
