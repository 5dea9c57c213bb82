#include "models/equations/equation_text.hpp"

#include "models/equations/equations.hpp"
#include "models/equations/interpreted_kernel.hpp"
#include "models/system/kernel_system.hpp"

namespace orbid::models {

std::shared_ptr<const System> system_from_text(const EquationText& text, std::vector<EquationProblem>& problems) {
    const auto equations = Equations::read(text, problems);
    if (!equations) return nullptr;
    std::string beyond;
    if (const auto kernel = interpreted_kernel(equations, beyond)) return std::make_shared<KernelSystem>(kernel);
    problems.push_back({EquationProblem::Part::model, 0, {}, beyond + " need compiled code"});
    return nullptr;
}

}  // namespace orbid::models
