#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#pragma GCC visibility push(default)

namespace orbid::identification {

/// A change of parameters, and of states that are not measured, that leaves every reading as it is.
struct UndeterminedDirection {
    enum class Kind {
        no_effect,   ///< of one parameter: any value gives the same readings
        scaling,     ///< each unknown times a whole power of one number
        shift,       ///< to each unknown a multiple of one number
        combination  ///< anything else
    };
    Kind kind = Kind::combination;
    std::vector<std::string> unknowns;  ///< coordinates of the model, then parameters of the estimate
    /// One per unknown. Of a scaling whole powers; of a shift multiples; otherwise relative changes of the parameters
    /// at the start, the largest 1 (of coordinates 0: they follow).
    std::vector<double> components;
    std::string held;  ///< the parameter that keeps its start value instead
    std::string text;  ///< a sentence without full stop
};

/// "no_effect", "scaling", "shift", "combination".
[[nodiscard]] std::string_view name(UndeterminedDirection::Kind kind);

/// What the readings of series can determine, whatever their number and precision.
struct StructuralReport {
    bool examined = false;
    std::string reason;  ///< why it was not examined; empty otherwise
    std::vector<UndeterminedDirection> directions;
    /// Coordinates whose signs may be turned together: equations and readings stay as they are.
    std::vector<std::vector<std::string>> signs;

    /// The reason why a parameter of the estimate is held; empty: it is not.
    [[nodiscard]] std::string why_held(const std::string& parameter) const {
        for (const UndeterminedDirection& direction : directions)
            if (direction.held == parameter) return direction.text;
        return {};
    }
};

}  // namespace orbid::identification

#pragma GCC visibility pop
