#include "models/equations/interpreted_shape_choice.hpp"

#include <algorithm>

#include "models/equations/interpreted_model.hpp"
#include "models/equations/interpreted_shape.hpp"

namespace orbid::models {

InterpretedShapeChoice interpreted_shape_for(const Equations& equations, std::string& why) {
    const std::size_t n = equations.coordinates().size();
    const Kind kind = equations.kind();
    const bool angles = std::any_of(equations.coordinates().begin(), equations.coordinates().end(),
                                    [](const Coordinate& c) { return c.angle; });
    const auto beyond = [&](const std::string& what) {
        why = what;
        return InterpretedShapeChoice{};
    };
    if (equations.text().stiff) return beyond("stiff equations");
    if (!equations.inputs().empty()) {
        if (equations.inputs().size() > InterpretedInputs<4>::inputs.size()) return beyond("more than four inputs");
        if (equations.dry_friction()) return {interpreted_shape<InterpretedFrictionInputs>, 2};
        if (!equations.surfaces().empty()) return beyond("switching surfaces together with measured inputs");
        if (n > 4) return beyond("more than four coordinates with measured inputs");
        if (n <= 2) return {interpreted_shape<InterpretedInputs<2>>, 2};
        return {interpreted_shape<InterpretedInputs<4>>, 4};
    }
    if (!equations.surfaces().empty() && !equations.dry_friction()) {
        if (n > 4) return beyond("more than four coordinates with switching surfaces");
        if (equations.surfaces().size() > InterpretedSurfaces<4>::surface_count)
            return beyond("more than four switching surfaces");
        if (kind == Kind::forced && n <= 2) return {interpreted_shape<InterpretedForcedSurfaces<2>>, 2};
        if (kind == Kind::forced) return {interpreted_shape<InterpretedForcedSurfaces<4>>, 4};
        if (n <= 2) return {interpreted_shape<InterpretedSurfaces<2>>, 2};
        return {interpreted_shape<InterpretedSurfaces<4>>, 4};
    }
    if (equations.dry_friction()) {
        if (kind == Kind::forced) return {interpreted_shape<InterpretedForcedFriction>, 2};
        return {interpreted_shape<InterpretedFriction>, 2};
    }
    switch (kind) {
        case Kind::map:
            if (n > 4) return beyond("a map of more than four coordinates");
            if (n <= 2) return {interpreted_shape<InterpretedMap<2>>, 2};
            return {interpreted_shape<InterpretedMap<4>>, 4};
        case Kind::forced:
            if (n > 6) return beyond("more than six coordinates with a forcing");
            if (n <= 2) return {interpreted_shape<InterpretedForcedFlow<2>>, 2};
            if (n <= 4) return {interpreted_shape<InterpretedForcedFlow<4>>, 4};
            return {interpreted_shape<InterpretedForcedFlow<6>>, 6};
        case Kind::autonomous:
            break;
    }
    if (n <= 2) return {interpreted_shape<InterpretedFlow<2>>, 2};
    if (n == 3) return {interpreted_shape<InterpretedFlow<3>>, 3};
    if (n == 4) return {interpreted_shape<InterpretedFlow<4>>, 4};
    if (angles) return beyond("more than four coordinates, some of them angles");
    return {interpreted_shape<InterpretedLargeFlow>, n};
}

}  // namespace orbid::models
