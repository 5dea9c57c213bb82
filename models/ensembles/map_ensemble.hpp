#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

#include "models/arithmetic/pack.hpp"
#include "models/definition/model.hpp"
#include "models/definition/simulation.hpp"
#include "models/system/stopped.hpp"

namespace orbid::models {

/// Iterates of many points under a map, in packs. What is not finite in a pack (its functions have a smaller range) is
/// computed once more in double. The iterates of a point therefore do not depend on what else is in the call. A map
/// that branches on its scalar says `packs = false` and is iterated in double.
template <MapModel M, class Arch = xsimd::default_arch>
class MapEnsemble {
public:
    static constexpr std::size_t n = dimension_of<M>;
    static constexpr std::size_t q = parameter_count_of<M>;
    static constexpr bool in_packs = !requires { requires !M::packs; };

    /// @param interrupted  as in FlowOptions
    explicit MapEnsemble(const Values<double, q>& p, const std::function<bool()>* interrupted = nullptr,
                         const M& model = M())
        : model_(model), p_(p), constants_(constants_from<M, double>(p, model)), interrupted_(interrupted) {}

    /// As Kernel::ensemble().
    void advance(const double* starts, std::size_t count, std::size_t iterations, double* const* sections,
                 std::size_t* columns, FlowStatus* status) const {
        for (std::size_t i = 0; i < count; ++i) {
            std::copy(starts + i * n, starts + (i + 1) * n, sections[i]);
            columns[i] = 1;
            status[i] = FlowStatus::ok;
        }
        if constexpr (in_packs) {
            for (std::size_t first = 0; first < count; first += P::width)
                pack(std::min(P::width, count - first), iterations, sections + first, columns + first, status + first);
        } else {
            for (std::size_t i = 0; i < count; ++i)
                while (columns[i] <= iterations && status[i] == FlowStatus::ok)
                    one(sections[i], columns[i], status[i]);
        }
    }

    /// Preferred number of points in one call of advance(): some packs.
    static constexpr std::size_t block = 64;

private:
    /// Four registers hide the latency of an operation.
    using P = Pack<4, Arch>;

    void pack(std::size_t count, std::size_t iterations, double* const* sections, std::size_t* columns,
              FlowStatus* status) const {
        Values<P, q> p;
        for (std::size_t j = 0; j < q; ++j)
            p[j] = P(p_[j]);
        const auto constants = constants_from<M, P>(p, model_);
        std::array<std::size_t, P::width> point;  // of each lane; those beyond `alive` repeat the last
        std::size_t alive = count;
        for (std::size_t l = 0; l < P::width; ++l)
            point[l] = std::min(l, count - 1);
        State<P, n> x;
        std::array<std::array<double, P::width>, n> lanes;
        const auto gather = [&](std::size_t column) {
            for (std::size_t c = 0; c < n; ++c) {
                for (std::size_t l = 0; l < P::width; ++l)
                    lanes[c][l] = sections[point[l]][column * n + c];
                x[c] = P::load(lanes[c].data());
            }
        };
        gather(0);
        for (std::size_t k = 1; k <= iterations && alive > 0; ++k) {
            if (k % 1024 == 0) stop_if_asked(interrupted_);
            x = model_.map(x, constants);
            auto finite = isfinite(x[0]);
            for (std::size_t c = 0; c < n; ++c) {
                finite = finite & isfinite(x[c]);
                x[c].store(lanes[c].data());
                if (model_.coordinates[c].angle) {
                    for (double& angle : lanes[c])
                        angle = wrapped(angle);
                    x[c] = P::load(lanes[c].data());
                }
            }
            if (finite.all()) {
                for (std::size_t l = 0; l < alive; ++l)
                    for (std::size_t c = 0; c < n; ++c)
                        sections[point[l]][k * n + c] = lanes[c][l];
                continue;
            }
            const auto good = finite.lanes();
            std::size_t left = 0;
            for (std::size_t l = 0; l < alive; ++l) {
                const std::size_t i = point[l];
                columns[i] = k;
                if (good[l]) {
                    for (std::size_t c = 0; c < n; ++c)
                        sections[i][k * n + c] = lanes[c][l];
                } else {
                    one(sections[i], columns[i], status[i]);
                }
                if (status[i] == FlowStatus::ok) point[left++] = i;
            }
            alive = left;
            for (std::size_t l = alive; l < P::width && alive > 0; ++l)
                point[l] = point[alive - 1];
            if (alive > 0) gather(k);
        }
        for (std::size_t l = 0; l < alive; ++l)
            columns[point[l]] = iterations + 1;
    }

    /// The next iterate of one point, in double.
    void one(double* sections, std::size_t& columns, FlowStatus& status) const {
        State<double, n> x;
        std::copy(sections + (columns - 1) * n, sections + columns * n, x.begin());
        if (columns % 1024 == 0) stop_if_asked(interrupted_);
        x = model_.map(x, constants_);
        for (std::size_t c = 0; c < n; ++c) {
            if (!std::isfinite(x[c])) status = FlowStatus::not_finite;
            sections[columns * n + c] = model_.coordinates[c].angle ? wrapped(x[c]) : x[c];
        }
        if (status == FlowStatus::ok) ++columns;
    }

    [[no_unique_address]] M model_;
    Values<double, q> p_;
    Constants<M, double> constants_;
    const std::function<bool()>* interrupted_;
};

}  // namespace orbid::models
