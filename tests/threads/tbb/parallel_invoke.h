#pragma once

#include "crew.h"

namespace tbb {

template <class First, class Second>
void parallel_invoke(const First& first, const Second& second) {
    detail::each(2, [&](std::size_t i) { i == 0 ? first() : second(); });
}

}  // namespace tbb
